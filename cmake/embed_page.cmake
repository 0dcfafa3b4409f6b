# cmake -DPAGE=folder -DTHREE=three.min.js -DPROGRAM=a.js,b.js,... -DOUT=file -P embed_page.cmake: the texts of the HTML
# page as C++ string literals. PROGRAM: the page's own files in the order in which they become one script.
string(REPLACE "," ";" program_files "${PROGRAM}")
set(program "\"use strict\";\n(() => {\n")
foreach(file IN LISTS program_files)
  file(READ ${PAGE}/${file} text)
  string(APPEND program "// ---- ${file}\n${text}\n")
endforeach()
string(APPEND program "})();\n")
file(READ ${PAGE}/page.html outline)
file(READ ${PAGE}/page.css style)
file(READ ${PAGE}/live.css live_style)
string(APPEND style "${live_style}")
file(READ ${PAGE}/three-licence.txt licence)
file(READ ${THREE} three)

# Literals of less than 64 KiB are what every compiler must take.
set(piece_length 60000)
set(arrays "")
set(parts "")
foreach(entry "page.html;outline" "style;style" "program;program" "three;three" "licence;licence")
  list(GET entry 0 name)
  list(GET entry 1 variable)
  set(text "${${variable}}")
  if(name MATCHES "style|program|three" AND text MATCHES "</script|</style|<!--|\\)page\"|\r")
    message(FATAL_ERROR "${name}: '${CMAKE_MATCH_0}' cannot stand in the page")
  endif()
  string(SHA256 hash "${text}")
  string(LENGTH "${text}" length)
  string(APPEND arrays "constexpr std::string_view ${variable}_pieces[] = {\n")
  set(at 0)
  while(at LESS length)
    string(SUBSTRING "${text}" ${at} ${piece_length} piece)
    string(APPEND arrays "    R\"page(${piece})page\"sv,\n")
    math(EXPR at "${at} + ${piece_length}")
  endwhile()
  string(APPEND arrays "};\n")
  string(APPEND parts "    {\"${name}\", ${variable}_pieces, \"${hash}\"},\n")
endforeach()
file(WRITE ${OUT}.new "// Written by cmake/embed_page.cmake.
#include \"interflect/output/page_parts.h\"

#include <string>

#include \"interflect/base/error.h\"

namespace interflect {

namespace {

using namespace std::string_view_literals;  // with the length at hand: some compilers will not count so far

${arrays}
constexpr PagePart parts[] = {
${parts}};

}  // namespace

std::span<const PagePart> page_parts() {
  return parts;
}

const PagePart& page_part(std::string_view name) {
  for (const PagePart& part : parts) {
    if (part.name == name) return part;
  }
  throw Error(ErrorKind::internal, \"page: no part '\" + std::string(name) + \"'\");
}

}  // namespace interflect
")
file(COPY_FILE ${OUT}.new ${OUT} ONLY_IF_DIFFERENT)
