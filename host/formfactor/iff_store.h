#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <future>
#include <string>
#include <vector>

#include "interflect/formfactor/descriptor.h"
#include "interflect/formfactor/iff_file.h"
#include "interflect/formfactor/iff_format.h"
#include "interflect/formfactor/panel_store.h"

namespace interflect {

/// About so many bytes a panel of a new file has: 32 MiB, or less by INTERFLECT_MAX_PANEL_BYTES.
[[nodiscard]] std::uint64_t iff_panel_target();

/// What a file for this mesh would be.
[[nodiscard]] iff::Shape iff_shape(const PatchMesh& mesh, double divide, bool two_sided, double eps,
                                   std::uint64_t seed);

/// What the end of the file says, once the report is complete.
[[nodiscard]] IffClosing iff_closing(const PatchMesh& mesh, const std::vector<Material>& materials, Closure closure,
                                     AssemblyReport report);

/// What keeps panels of the one from serving the other, in words: "its geometry is another", "its accuracy is 0.02,
/// 0.005 is asked". Empty when nothing does.
[[nodiscard]] std::string difference(const iff::Shape& has, const iff::Shape& wanted);

/// Keeps panels in a file, each written while the next one is computed. A process that is killed at any moment leaves
/// what is finished, and the next one goes on there; the complete file has the same bytes. Another process that writes
/// the same file is kept out by a lock.
class IffStore final : public PanelStore {
 public:
  enum class Mode {
    make,    ///< writes FILE.partial, continued where it fits; finish() renames it
    repair,  ///< works on FILE itself: damaged panels count as not there, finish() writes the closing section again
    close,   ///< gives the panels of FILE, a damaged one is an Error; finish() writes the closing section again
    read,    ///< gives the panels of FILE, a damaged one is an Error; finish() must not be called
  };
  struct Options {
    Mode mode = Mode::make;
    std::function<bool()> stop = {};                   ///< asked after each panel; true: save() throws interrupted
    std::function<void(const std::string&)> say = {};  ///< what the user should know: started anew, continued
  };
  /// Throws an input Error when the file cannot be written to (a folder, read-only, another process at work), when it
  /// does not fit `wanted` (a FILE.partial without a finished panel is started anew instead), or when FILE.partial, or
  /// FILE in repair, is not known to be a file of form factors: it is left as it is. A limit Error when the disk is
  /// full.
  IffStore(const std::filesystem::path& file, const iff::Shape& wanted, Options options);
  ~IffStore() override;

  [[nodiscard]] std::uint32_t rows_per_panel() const override { return shape_.rows_per_panel; }
  [[nodiscard]] bool has(std::uint32_t panel) const override;
  void read_columns(std::uint32_t panel, std::uint32_t first, std::uint32_t columns,
                    std::span<float> to) const override;
  [[nodiscard]] TileFacts load(std::uint32_t panel, FormFactorMatrix& s) override;
  void prepare(std::uint32_t panel) override;
  void save(std::uint32_t panel, const FormFactorMatrix& s, const TileFacts& facts) override;

  [[nodiscard]] const iff::Shape& shape() const { return shape_; }
  /// The panels that have been saved since the store was opened.
  [[nodiscard]] const std::vector<std::uint32_t>& saved() const { return saved_; }

  // For ranks that fill the file together (rank_store.h).
  [[nodiscard]] const std::string& worked_on() const { return name_; }                ///< FILE.partial
  [[nodiscard]] const std::vector<iff::EntryBytes>& table() const { return table_; }  ///< valid or not
  /// A panel that another process has written and synced.
  void take(const iff::EntryBytes& entry) { write(entry); }

  /// "3 of 26 panels are kept in FILE.partial, and the same command goes on from there": what this process leaves when
  /// it ends now, with the panel in hand finished.
  [[nodiscard]] std::string how_to_go_on() const;
  /// Whether what is finished fits only the maker in `wanted`: not while FILE.partial has no panel, nor where none is
  /// computed.
  [[nodiscard]] bool bound_to_maker() const;

  /// Writes the closing section; the file is complete, under its name and on the disk when this returns. Every panel
  /// must be there. Throws as save().
  void finish(const IffClosing& closing);

 private:
  void open_partial(const iff::Shape& wanted);
  void open_complete(const iff::Shape& wanted);
  void lock();
  void go_on(const iff::Shape& wanted);
  void start(const iff::Shape& wanted);
  [[nodiscard]] bool restore_header(const iff::Shape& wanted);
  [[nodiscard]] bool read(std::uint32_t panel) const;
  void check_symmetry(std::uint32_t panel, const FormFactorMatrix& s) const;
  void sync();
  [[nodiscard]] iff::EntryBytes entry_of(std::uint32_t panel, const TileFacts& facts) const {
    return iff::finished_entry(panel, std::as_bytes(std::span(rows_).first(shape_.panel_bytes(panel) / sizeof(float))),
                               facts, seed_);
  }
  void check_same(const iff::EntryBytes& entry) const;
  [[nodiscard]] bool last_valid(std::uint32_t panel) const;
  void write(const iff::EntryBytes& entry, const std::vector<float>& variance);
  void write(const iff::EntryBytes& entry);
  void wait() const;
  [[nodiscard]] bool closes_with(const iff::ClosingBytes& front, std::span<const std::byte> body) const;
  [[nodiscard]] Error no_room(const Error& cause, std::uint32_t panel) const;
  [[nodiscard]] Error comes_out_otherwise(std::uint32_t panel) const;
  [[nodiscard]] std::uint32_t kept() const;

  std::filesystem::path path_;  ///< the final name
  std::string name_;            ///< of the file that is worked on
  Options options_;
  Descriptor file_;
  iff::Shape shape_;
  std::uint64_t seed_ = 0;
  std::vector<iff::EntryBytes> table_;
  std::vector<std::uint32_t> saved_;
  std::vector<iff::EntryBytes> unproven_;  ///< of repaired panels: they count once all panels behind have agreed
  // The panel that was read last: has() looks at it, load() takes it; save() writes from there.
  mutable std::vector<float> rows_, variance_;
  mutable std::uint32_t held_;
  // The panel that is being written from rows_, beside the computation of the next one.
  std::uint32_t writing_ = 0;
  mutable std::future<void> pending_;
};

}  // namespace interflect
