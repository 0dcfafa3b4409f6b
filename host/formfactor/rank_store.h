#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "interflect/base/ranks.h"
#include "interflect/formfactor/form_factor_matrix.h"
#include "interflect/formfactor/iff_store.h"
#include "interflect/formfactor/row_shares.h"

namespace interflect {

/// The panels of a file of form factors (IffStore in mode make) that several ranks fill together: rank 0 has the
/// IffStore, and with it header, table and closing section; each rank writes the panels of its own rows through
/// Ranks::open(). A job that ends at any moment leaves a FILE.partial that any number of ranks goes on with; the
/// complete file has the bytes that one process writes. Everything is collective.
class RankStore {
 public:
  /// Errors of IffStore's constructor, as AgreedErrors.
  RankStore(Ranks& ranks, const std::filesystem::path& file, const iff::Shape& wanted,
            const IffStore::Options& options);

  [[nodiscard]] const iff::Shape& shape() const { return shape_; }
  /// The rows of each rank: whole panels.
  [[nodiscard]] const std::vector<RowShare>& shares() const { return shares_; }
  /// Whether the file had the panel when load() was called; the same on every rank.
  [[nodiscard]] bool kept(std::uint32_t panel) const { return kept_.at(panel); }
  [[nodiscard]] std::uint32_t kept_count() const;

  /// Reads the panels that are there and sound into this rank's rows, and their mirror images into the columns.
  void load(FormFactorMatrix& rows);
  /// What is known of a panel that was there, besides its rows. Not collective.
  [[nodiscard]] TileFacts facts(std::uint32_t panel) const;

  struct Finished {
    std::uint32_t panel = 0;
    TileFacts facts = {};
  };
  /// Writes panels from this rank's rows (a rank may have none) and, when those of all ranks are on the disk, their
  /// entries of the table.
  void save(const FormFactorMatrix& rows, std::span<const Finished> panels);
  /// Whether the user wants an end, as rank 0 has heard.
  [[nodiscard]] bool stop();
  /// Says how to go on, on every rank.
  [[nodiscard]] AgreedError interrupted();
  /// The closing section, of which rank 0's counts: the file is complete, under its name, when this returns.
  void finish(const IffClosing& closing);

 private:
  void verify(FormFactorMatrix& rows);
  void mirror(FormFactorMatrix& rows) const;

  Ranks& ranks_;
  IffStore::Options options_;
  std::optional<IffStore> front_;  ///< on rank 0
  std::string name_;               ///< of the file that is worked on
  iff::Shape shape_;
  std::uint64_t seed_ = 0;
  std::vector<iff::EntryBytes> table_;  ///< as it was at first
  std::vector<bool> kept_;
  std::vector<RowShare> shares_;
  Descriptor reading_;
  std::unique_ptr<RankFile> writing_;
};

}  // namespace interflect
