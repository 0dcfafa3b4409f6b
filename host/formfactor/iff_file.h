#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "interflect/formfactor/assembly.h"
#include "interflect/formfactor/descriptor.h"
#include "interflect/formfactor/form_factor_rows.h"
#include "interflect/formfactor/iff_format.h"

namespace interflect {

/// What a surface is called, without its looks.
struct SurfaceNames {
  std::string object, group, material;
  friend bool operator==(const SurfaceNames&, const SurfaceNames&) = default;
};

/// What the end of a file holds: all that is known beside S.
struct IffClosing {
  Closure closure = Closure::automatic;  ///< as it was asked for
  AssemblyReport report;                 ///< without seconds and what the panels have: pairs, rays, variances
  std::vector<double> area;              ///< A_i
  std::vector<std::uint32_t> surface;    ///< per patch
  std::vector<SurfaceNames> surfaces;
};

/// A complete file of form factors, for reading. S by panels, d apart: F_ij = S_ij (d_i / A_i) d_j. Every const
/// function may be called from several threads.
class IffFile {
 public:
  /// Reads header, table and closing section. Throws an input Error naming the file when it cannot be read, is not one,
  /// is of another version, is shorter than it says, or when header or closing section are damaged. Damaged panels are
  /// found when they are read.
  [[nodiscard]] static IffFile open(const std::filesystem::path& path);
  /// The same for whoever finds the closure anew: a file of which only the closing section is missing or damaged is
  /// opened as well. closing_damage() then says so, and nothing of the closing section is known: areas are empty.
  [[nodiscard]] static IffFile open_panels(const std::filesystem::path& path);
  [[nodiscard]] const std::string& closing_damage() const { return closing_damage_; }

  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] const iff::Shape& shape() const { return shape_; }
  [[nodiscard]] std::uint32_t n() const { return shape_.n; }
  [[nodiscard]] std::uint32_t stride() const { return shape_.stride(); }  ///< floats from one row to the next
  [[nodiscard]] std::uint32_t rows_per_panel() const { return shape_.rows_per_panel; }
  [[nodiscard]] std::uint32_t panels() const { return shape_.panels(); }
  [[nodiscard]] std::uint32_t first(std::uint32_t panel) const { return shape_.first(panel); }
  [[nodiscard]] std::uint32_t rows(std::uint32_t panel) const { return shape_.rows(panel); }
  [[nodiscard]] double accuracy() const { return shape_.key.eps; }  ///< Accuracy::eps
  [[nodiscard]] std::uint64_t seed() const { return shape_.key.seed; }
  [[nodiscard]] double divide() const { return shape_.divide; }
  [[nodiscard]] bool two_sided() const { return shape_.two_sided; }

  [[nodiscard]] const std::vector<double>& area() const { return closing_.area; }
  [[nodiscard]] const std::vector<double>& scaling() const { return closing_.report.scaling; }  ///< d
  /// Whether the closing section is sound and of this closure.
  [[nodiscard]] bool closed_as(Closure closure) const { return closing_damage_.empty() && closing_.closure == closure; }
  [[nodiscard]] const IffClosing& closing() const { return closing_; }
  /// All that was known when the file was made, with the facts of all panels; seconds 0, panels_reused all of them.
  /// Throws an input Error that names a panel whose facts are damaged.
  [[nodiscard]] AssemblyReport report() const;

  /// S of the panel's rows: rows(panel) * stride() floats, the padding 0. Throws an input Error "FILE: panel 3 (rows
  /// 1536 to 2047): checksum differs; `--repair` computes it again". `verify`: false for one that was read before and
  /// found sound.
  void read_panel(std::uint32_t panel, std::span<float> rows, bool verify = true) const;
  /// The panel's facts, with its tiles' variances. Throws as read_panel().
  [[nodiscard]] TileFacts facts(std::uint32_t panel) const;
  /// The panels whose rows or facts are not what they were: reads the whole file.
  [[nodiscard]] std::vector<std::uint32_t> damaged() const;

 private:
  friend class IffStore;
  IffFile() = default;
  void read_closing(std::uint64_t bytes);
  [[nodiscard]] Error damage(std::uint32_t panel) const;

  std::string name_;
  Descriptor file_;
  iff::Shape shape_;
  std::uint64_t seed_of_checksums_ = 0;
  std::vector<iff::EntryBytes> table_;
  IffClosing closing_;
  std::string closing_damage_;
};

/// The rows of F, with one panel in memory at a time. The file must outlive what is returned.
[[nodiscard]] FormFactorRows rows_of(const IffFile& file);

/// How many panels are read at a time, each into a buffer, where F and the buffers may have memory_limit bytes: as many
/// as there are threads and panels, or fewer. Throws a limit Error when not even one buffer fits beside F.
[[nodiscard]] std::uint32_t panels_at_a_time(const IffFile& file, std::uint64_t memory_limit, std::uint32_t threads);

/// F in memory and its report, the same to the bit as when the file was made. Throws a limit Error, before anything is
/// read, when more than memory_limit bytes (0: available_memory()) are needed, and what read_panel() throws.
[[nodiscard]] FormFactors read_form_factors(const IffFile& file, std::uint64_t memory_limit = 0);

/// The groups of the file's surfaces, as group_surfaces() of the scene.
[[nodiscard]] Grouping group_surfaces(const IffFile& file, GroupBy by);
[[nodiscard]] GroupFactors between(const IffFile& file, const Grouping& grouping);

}  // namespace interflect
