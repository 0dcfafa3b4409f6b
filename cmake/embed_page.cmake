# cmake -DPAGE=folder -DTHREE=three.min.js -DPROGRAM=a.js,b.js,... -DOUT=file -P embed_page.cmake: the texts of the HTML
# page, packed by gzip, as C++ arrays. PROGRAM: the page's own files in the order in which they become one script.
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

set(arrays "")
set(parts "")
foreach(entry "page.html;outline" "style;style" "program;program" "three;three" "licence;licence")
  list(GET entry 0 name)
  list(GET entry 1 variable)
  set(text "${${variable}}")
  if(name MATCHES "style|program|three" AND text MATCHES "</script|</style|<!--|\r")
    message(FATAL_ERROR "${name}: '${CMAKE_MATCH_0}' cannot stand in the page")
  endif()
  string(SHA256 hash "${text}")
  string(LENGTH "${text}" length)
  # Packed they take a quarter of the room in the library.
  file(WRITE ${OUT}.text "${text}")
  file(ARCHIVE_CREATE OUTPUT ${OUT}.gz PATHS ${OUT}.text FORMAT raw COMPRESSION GZip COMPRESSION_LEVEL 9)
  file(READ ${OUT}.gz bytes HEX)
  # No time of day in gzip's header: the same text, the same bytes.
  string(SUBSTRING "${bytes}" 0 8 start)
  string(SUBSTRING "${bytes}" 16 -1 rest)
  set(bytes "${start}00000000${rest}")
  string(REGEX REPLACE "(..)" "0x\\1," bytes "${bytes}")
  string(APPEND arrays "constexpr unsigned char ${variable}_packed[] = {${bytes}};\n")
  string(APPEND parts "    {\"${name}\", ${variable}_packed, ${length}, \"${hash}\"},\n")
endforeach()
file(WRITE ${OUT}.new "// Written by cmake/embed_page.cmake.
#include \"interflect/output/page_parts.h\"

namespace interflect {

namespace {

${arrays}
constexpr PagePart parts[] = {
${parts}};

}  // namespace

std::span<const PagePart> page_parts() {
  return parts;
}

}  // namespace interflect
")
file(COPY_FILE ${OUT}.new ${OUT} ONLY_IF_DIFFERENT)
file(REMOVE ${OUT}.text ${OUT}.gz)
