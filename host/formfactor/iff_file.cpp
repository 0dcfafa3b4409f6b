#include "interflect/formfactor/iff_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <omp.h>

#include <algorithm>
#include <cerrno>
#include <exception>

#include "interflect/base/memory.h"
#include "interflect/base/timer.h"
#include "interflect/formfactor/iff_closing.h"
#include "interflect/formfactor/simd.h"

namespace interflect {

namespace {

constexpr std::string_view how_to_repair = "`--repair` computes it again";

std::span<std::byte> bytes_of(std::span<float> values) {
  return std::as_writable_bytes(values);
}

}  // namespace

std::vector<iff::EntryBytes> iff::read_table(const Descriptor& file, const std::string& name, const iff::Shape& shape) {
  std::vector<iff::EntryBytes> table(shape.panels());
  if (!read_at(file, name, iff::Shape::table_offset(), std::as_writable_bytes(std::span(table)))) {
    throw input_error(name, 0, "ends within its table of panels");
  }
  return table;
}

IffFile IffFile::open(const std::filesystem::path& path) {
  IffFile out = open_panels(path);
  if (!out.closing_damage_.empty()) {
    throw Error(ErrorKind::input, fmt::format("{}; {}", out.closing_damage_, how_to_repair));
  }
  return out;
}

IffFile IffFile::open_panels(const std::filesystem::path& path) {
  IffFile out;
  out.name_ = path.string();
  out.file_ = Descriptor(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (!out.file_) throw file_error(out.name_, "open", errno);
  const std::uint64_t bytes = size_of(out.file_, out.name_);
  iff::HeaderBytes header{};
  if (bytes < sizeof header || !read_at(out.file_, out.name_, 0, std::as_writable_bytes(std::span(&header, 1)))) {
    throw input_error(out.name_, 0, fmt::format("is not a file of form factors (.iff): it has only {} bytes", bytes));
  }
  out.shape_ = iff::shape_of(header, out.name_);
  out.seed_of_checksums_ = iff::seed_of(out.shape_);

  const std::uint64_t end = out.shape_.closing_offset();
  if (bytes < end) {
    throw input_error(out.name_, 0,
                      fmt::format("is cut short: it has {} bytes, and its {} patches need more than {}", bytes,
                                  out.shape_.n, end + sizeof(iff::ClosingBytes)));
  }
  out.table_ = iff::read_table(out.file_, out.name_, out.shape_);
  try {
    out.read_closing(bytes);
  } catch (const Error& error) {
    if (error.kind() != ErrorKind::input) throw;
    out.closing_damage_ = error.what();
  }
  return out;
}

/// Of a file of so many bytes.
void IffFile::read_closing(std::uint64_t bytes) {
  const std::uint64_t end = shape_.closing_offset();
  iff::ClosingBytes closing{};
  const bool there = read_at(file_, name_, end, std::as_writable_bytes(std::span(&closing, 1)));
  if (!there || bytes - end - sizeof closing != closing.bytes) {
    throw input_error(name_, 0, "closing section: its length is not that of the file's end");
  }
  constexpr std::uint64_t names_and_warnings = std::uint64_t{1} << 30, per_patch = 64;
  if (closing.bytes > names_and_warnings + per_patch * shape_.n) {
    throw input_error(name_, 0, "closing section: it is too long");
  }
  std::vector<std::byte> body(closing.bytes);
  if (!read_at(file_, name_, end + sizeof closing, body) ||
      iff::checksum(body, seed_of_checksums_) != closing.checksum) {
    throw input_error(name_, 0, "closing section: checksum differs");
  }
  closing_ = iff::decode(body, shape_.n, name_);
}

Error IffFile::damage(std::uint32_t panel) const {
  return input_error(name_, 0, fmt::format("{}: checksum differs; {}", iff::panel_name(shape_, panel), how_to_repair));
}

void IffFile::read_panel(std::uint32_t panel, std::span<float> rows, bool verify) const {
  if (panel >= panels() || rows.size_bytes() != shape_.panel_bytes(panel)) {
    throw Error(ErrorKind::internal, fmt::format("{}: panel {} asked for {} floats", name_, panel, rows.size()));
  }
  const iff::EntryBytes& entry = table_[panel];
  if (!iff::valid(entry, panel, seed_of_checksums_) ||
      !read_at(file_, name_, shape_.panel_offset(panel), bytes_of(rows)) ||
      (verify && iff::checksum(std::as_bytes(rows)) != entry.rows_checksum)) {
    throw damage(panel);
  }
}

TileFacts IffFile::facts(std::uint32_t panel) const {
  const iff::EntryBytes& entry = table_.at(panel);
  if (!iff::valid(entry, panel, seed_of_checksums_)) throw damage(panel);
  TileFacts facts{entry.pairs, entry.analytic, entry.rays, 0, std::vector<float>(shape_.variances(panel))};
  if (!read_at(file_, name_, shape_.variance_offset(panel), bytes_of(facts.variance)) ||
      iff::checksum(std::as_bytes(std::span(facts.variance))) != entry.variance_checksum) {
    throw damage(panel);
  }
  return facts;
}

std::vector<std::uint32_t> IffFile::damaged() const {
  std::vector<std::uint32_t> out;
  std::vector<float> rows(shape_.panel_bytes(0) / sizeof(float));
  for (std::uint32_t panel = 0; panel < panels(); ++panel) {
    try {
      (void)facts(panel);
      read_panel(panel, std::span(rows).first(shape_.panel_bytes(panel) / sizeof(float)));
    } catch (const Error&) {
      out.push_back(panel);
    }
  }
  return out;
}

AssemblyReport IffFile::report() const {
  AssemblyReport report = closing_.report;
  for (std::uint32_t panel = 0; panel < panels(); ++panel) {
    const TileFacts known = facts(panel);
    report.pairs_considered += known.pairs_considered;
    report.pairs_analytic += known.pairs_analytic;
    report.rays += known.rays;
    report.tile_variance.insert(report.tile_variance.end(), known.variance.begin(), known.variance.end());
  }
  report.panels_reused = panels();
  return report;
}

namespace {

/// The panels, so many at a time, each into where the matrix has its rows.
void read_panels(const IffFile& file, FormFactorMatrix& s, std::uint32_t at_a_time) {
  std::exception_ptr failure;
#pragma omp parallel num_threads(static_cast <int>(at_a_time))
  {
    std::vector<float> rows;
#pragma omp for schedule(dynamic)
    for (std::uint32_t panel = 0; panel < file.panels(); ++panel) {
      try {
        rows.resize(std::size_t{file.rows(panel)} * file.stride());
        file.read_panel(panel, rows);
        for (std::uint32_t k = 0; k < file.rows(panel); ++k) {
          const auto row = std::span(rows).subspan(std::size_t{k} * file.stride(), file.n());
          std::copy(row.begin(), row.end(), s.row(file.first(panel) + k).begin());
        }
      } catch (...) {
#pragma omp critical(interflect_iff_read)
        if (!failure) failure = std::current_exception();
      }
    }
  }
  if (failure) std::rethrow_exception(failure);
}

}  // namespace

std::uint32_t panels_at_a_time(const IffFile& file, std::uint64_t memory_limit, std::uint32_t threads) {
  const std::uint64_t matrix = FormFactorMatrix::predicted_bytes(file.n()), buffer = file.shape().panel_bytes(0);
  const std::uint64_t needed = matrix + buffer;
  if (needed > memory_limit) {
    constexpr double mebibyte = 1 << 20;
    throw Error(ErrorKind::limit,
                fmt::format("{}: its {} patches need {:.0f} MiB, and {:.0f} MiB may be used", file.name(), file.n(),
                            static_cast<double>(needed) / mebibyte, static_cast<double>(memory_limit) / mebibyte));
  }
  return static_cast<std::uint32_t>(
      std::min<std::uint64_t>((memory_limit - matrix) / buffer, std::min(threads, file.panels())));
}

FormFactors read_form_factors(const IffFile& file, std::uint64_t memory_limit) {
  const Timer timer;
  if (memory_limit == 0) memory_limit = available_memory();
  const std::uint32_t at_a_time =
      panels_at_a_time(file, memory_limit, static_cast<std::uint32_t>(omp_get_max_threads()));
  FormFactors out;
  out.report = file.report();
  out.matrix = FormFactorMatrix(file.n());
  read_panels(file, out.matrix, at_a_time);
  Scaling scaling;
  scaling.d = out.report.scaling;
  make_form_factors(out.matrix, file.area(), scaling);
  out.report.seconds = timer.seconds();
  return out;
}

FormFactorRows rows_of(const IffFile& file) {
  return [&file](const RowVisitor& visit) {
    const std::vector<double>& d = file.scaling();
    const std::vector<float> x(d.begin(), d.end());
    std::vector<float> rows;
    for (std::uint32_t panel = 0; panel < file.panels(); ++panel) {
      rows.resize(std::size_t{file.rows(panel)} * file.stride());
      file.read_panel(panel, rows);
      for (std::uint32_t k = 0; k < file.rows(panel); ++k) {
        const std::uint32_t i = file.first(panel) + k;
        const auto row = std::span(rows).subspan(std::size_t{k} * file.stride(), file.n());
        const double area = file.area()[i];
        simd::scale(row, area > 0 ? static_cast<float>(d[i] / area) : 0.0F, x);
        visit(i, row);
      }
    }
  };
}

Grouping group_surfaces(const IffFile& file, GroupBy by) {
  Scene names;  // what group_surfaces() looks at, and no more
  for (const SurfaceNames& surface : file.closing().surfaces) {
    names.surfaces.push_back({surface.object, surface.group, static_cast<std::uint32_t>(names.materials.size()),
                              surface.material == obstruction_material});
    names.materials.emplace_back().name = surface.material;
  }
  return group_surfaces(names, by);
}

GroupFactors between(const IffFile& file, const Grouping& grouping) {
  return between(rows_of(file), file.area(), file.closing().surface, grouping);
}

}  // namespace interflect
