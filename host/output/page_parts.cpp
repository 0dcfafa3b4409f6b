#include "interflect/output/page_parts.h"

#include <fmt/format.h>
#include <zlib.h>

#include "interflect/base/error.h"

namespace interflect {

const PagePart& page_part(std::string_view name) {
  for (const PagePart& part : page_parts()) {
    if (part.name == name) return part;
  }
  throw Error(ErrorKind::internal, fmt::format("page: no part '{}'", name));
}

std::string text_of(const PagePart& part) {
  std::string text(part.size, '\0');
  z_stream stream{};
  stream.next_in = const_cast<Bytef*>(part.packed.data());  // zlib does not write there
  stream.avail_in = static_cast<uInt>(part.packed.size());
  stream.next_out = reinterpret_cast<Bytef*>(text.data());
  stream.avail_out = static_cast<uInt>(text.size());
  constexpr int gzip = 16 + MAX_WBITS;
  int result = inflateInit2(&stream, gzip);
  if (result == Z_OK) {
    result = inflate(&stream, Z_FINISH);
    inflateEnd(&stream);
  }
  if (result != Z_STREAM_END || stream.avail_out != 0) {
    throw Error(ErrorKind::internal, fmt::format("page: the part '{}' is damaged", part.name));
  }
  return text;
}

}  // namespace interflect
