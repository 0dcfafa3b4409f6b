#include <fmt/format.h>

#include <cstdint>
#include <iterator>
#include <string>

#include "interflect/base/file.h"
#include "interflect/output/bytes.h"
#include "interflect/output/output.h"
#include "interflect/output/smooth.h"

namespace interflect {

namespace {

constexpr std::size_t chunk = std::size_t{1} << 20;

/// Length of the valid UTF-8 sequence at the start of the text (RFC 3629: no overlong forms, no surrogates), or 0.
std::size_t sequence_length(std::string_view text) {
  const auto byte = [&](std::size_t k) { return k < text.size() ? static_cast<unsigned char>(text[k]) : 0U; };
  const unsigned lead = byte(0), second = byte(1);
  const auto follows = [&](std::size_t k) { return (byte(k) & 0xC0U) == 0x80U; };
  if (lead < 0x80) return 1;
  if (lead >= 0xC2 && lead <= 0xDF) return follows(1) ? 2 : 0;
  if (lead >= 0xE0 && lead <= 0xEF) {
    if ((lead == 0xE0 && second < 0xA0) || (lead == 0xED && second > 0x9F)) return 0;
    return follows(1) && follows(2) ? 3 : 0;
  }
  if (lead >= 0xF0 && lead <= 0xF4) {
    if ((lead == 0xF0 && second < 0x90) || (lead == 0xF4 && second > 0x8F)) return 0;
    return follows(1) && follows(2) && follows(3) ? 4 : 0;
  }
  return 0;
}

/// A field by RFC 4180.
std::string csv_field(const std::string& text) {
  if (text.find_first_of(",\"") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"') quoted += '"';
    quoted += c;
  }
  return quoted + '"';
}

}  // namespace

std::string printable_name(std::string_view name) {
  std::string out;
  while (!name.empty()) {
    const std::size_t length = sequence_length(name);
    const auto lead = static_cast<unsigned char>(name[0]);
    if (length == 0) {
      out += "\xEF\xBF\xBD";
    } else if (lead < 0x20 || lead == 0x7F) {
      out += ' ';
    } else {
      out += name.substr(0, length);
    }
    name.remove_prefix(std::max<std::size_t>(length, 1));
  }
  return out;
}

void write_csv(const Solution& solution, const std::filesystem::path& path) {
  check_solution(solution);
  const PatchMesh& mesh = *solution.mesh;
  std::vector<std::string> names;
  for (const std::string& name : solution.grouping.names) names.push_back(csv_field(printable_name(name)));
  AtomicFile file(path);
  std::string text = "index,group,area,cx,cy,cz,nx,ny,nz,rho_r,rho_g,rho_b,e_r,e_g,e_b,b_r,b_g,b_b,row_sum\n";
  const auto numbers = [&](double a, double b, double c) {
    fmt::format_to(std::back_inserter(text), ",{},{},{}", a, b, c);
  };
  for (std::size_t i = 0; i < mesh.size(); ++i) {
    const std::string& group = names[solution.grouping.of_surface[mesh.surface[i]]];
    fmt::format_to(std::back_inserter(text), "{},{},{}", i, group, mesh.area[i]);
    numbers(mesh.centroid[i].x, mesh.centroid[i].y, mesh.centroid[i].z);
    numbers(mesh.normal[i].x, mesh.normal[i].y, mesh.normal[i].z);
    for (const Rgb& colour : {mesh.reflectance[i], mesh.emittance[i], solution.radiosity[i]}) {
      numbers(colour[0], colour[1], colour[2]);
    }
    fmt::format_to(std::back_inserter(text), ",{}\n", solution.row_sum[i]);
    if (text.size() < chunk) continue;
    file.write(text);
    text.clear();
  }
  file.write(text);
  file.commit();
}

std::string npy_header(const std::string& shape) {
  // Magic, version, length of the header, the header padded so that the data is 64-aligned.
  std::string header = fmt::format("{{'descr': '<f4', 'fortran_order': False, 'shape': {}, }}", shape);
  constexpr std::size_t before = 10, alignment = 64;
  const std::size_t unpadded = before + header.size() + 1;
  header.append((alignment - unpadded % alignment) % alignment, ' ');
  header += '\n';
  std::string bytes("\x93NUMPY\x01\x00", 8);
  append_little_endian(bytes, static_cast<std::uint16_t>(header.size()));
  return bytes + header;
}

void write_npy(const Solution& solution, const std::filesystem::path& path) {
  check_solution(solution);
  std::string bytes = npy_header(fmt::format("({}, 3)", solution.radiosity.size()));
  bytes.reserve(bytes.size() + 12 * solution.radiosity.size());
  for (const Rgb& b : solution.radiosity) {
    for (const double c : b) append_little_endian(bytes, static_cast<float>(c));
  }
  AtomicFile file(path);
  file.write(bytes);
  file.commit();
}

}  // namespace interflect
