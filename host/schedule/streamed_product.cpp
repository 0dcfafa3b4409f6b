#include <algorithm>
#include <array>
#include <map>
#include <memory>
#include <utility>

#include "interflect/device/tuning.h"
#include "interflect/schedule/product.h"
#include "interflect/schedule/scheduler.h"

namespace interflect {

namespace {

/// y = t ∘ (S (s ∘ x)) over panels of S of which memory holds a part: a launch of matvec for each panel, those that
/// stream while the next ones are read.
///
/// Where the device uses the host's memory, panels are used where they were read. Else the first ones, as many as the
/// stream could keep, lie on the device, and the others go through two buffers there, in turn.
///
/// Traffic of a product beside that of dense32, in column values: scale twice, 2 reads, 1 write each.
class StreamedProduct final : public Product {
 public:
  StreamedProduct(const StreamedMatrix& form_factors, Device& device, const VectorArguments& shape,
                  std::uint32_t groups)
      : Product(device, shape, groups),
        form_factors_(form_factors),
        stream_(form_factors.stream()),
        macros_(launch_macros(device.info(), "matvec", shape.columns)),
        group_(static_cast<std::uint32_t>(macros_.at("ROWS"))),
        most_rows_(rows_of_a_launch(device.info(), form_factors.size(), form_factors.stride(), group_)),
        shares_(shares()) {
    stream_.keep(stream_.fitting());
    if (shares_) return;
    on_device_ = panels_for_the_device();
    // A processor's device has the host's memory: not twice.
    stream_.keep(device.info().type == DeviceType::cpu ? 0 : stream_.fitting(), on_device_);
  }

  [[nodiscard]] std::uint64_t needed_bytes() const override {
    const std::uint64_t vectors = 2 * vector_bytes() + 2 * form_factors_.size() * sizeof(float);
    const std::uint64_t host = device_.info().type == DeviceType::cpu ? stream_.bytes_to_allocate() : 0;
    return vectors + host + on_device_ * stream_.panel_bytes() + (uses_turns() ? 2 * turn_bytes() : 0);
  }
  void place() override {
    use(shape_, groups_);
    scale_ = compiled("scale", {});
    in_ = uploaded(std::as_bytes(form_factors_.scale_in()));
    out_ = uploaded(std::as_bytes(form_factors_.scale_out()));
    scaled_ = device_.allocate(vector_bytes());
    sums_ = device_.allocate(vector_bytes());
    if (uses_turns()) {
      for (std::unique_ptr<Buffer>& turn : turns_) turn = device_.allocate(turn_bytes());
    }
    if (on_device_ > 0) upload_first_panels();
  }
  void apply(Buffer& x, Buffer& y) override {
    launch(*scale_, groups_, std::array{&x, in_.get(), scaled_.get()}, shape_, "xs = d x");
    for (const Piece& piece : pieces_) multiply(piece.first, piece.rows, *piece.buffer);
    if (on_device_ < stream_.panels().panels()) {
      stream_.pass([&](const PanelStream::View& view) { shares_ ? in_place(view) : in_turn(view); }, on_device_);
    }
    launch(*scale_, groups_, std::array{sums_.get(), out_.get(), &y}, shape_, "y = d / A (S xs)");
  }
  [[nodiscard]] std::vector<Buffer*> panel_buffers() const override {
    std::vector<Buffer*> buffers;
    for (const Piece& piece : pieces_) buffers.push_back(piece.buffer.get());
    for (const auto& [panel, buffer] : shared_) buffers.push_back(buffer.get());
    return buffers;
  }
  [[nodiscard]] Storage storage() const override { return Storage::dense32; }
  [[nodiscard]] std::uint64_t bytes() const override { return form_factors_.bytes(); }
  void exact(const Columns& x, std::vector<std::vector<double>>& y) const override {
    exact_product(form_factors_, x, y);
  }

 private:
  [[nodiscard]] std::unique_ptr<Kernel> compile_multiply() override {
    return compiled("matvec", with_columns(macros_));  // the same rows for a group, by which the launches are cut
  }

  /// Rows of S on the device.
  struct Piece {
    std::uint32_t first = 0, rows = 0;
    std::unique_ptr<Buffer> buffer;
  };

  [[nodiscard]] std::uint64_t row_bytes() const { return std::uint64_t{form_factors_.stride()} * sizeof(float); }
  [[nodiscard]] std::uint64_t vector_bytes() const {
    return std::uint64_t{most_columns_} * shape_.vector_stride * sizeof(float);
  }
  [[nodiscard]] std::uint32_t rows_of_a_turn() const { return std::min(most_rows_, stream_.panels().rows(0)); }
  [[nodiscard]] std::uint64_t turn_bytes() const { return rows_of_a_turn() * row_bytes(); }
  [[nodiscard]] bool uses_turns() const { return !shares_ && on_device_ < stream_.panels().panels(); }

  [[nodiscard]] bool shares() const {
    const std::uint64_t most = device_.info().max_buffer_bytes;
    return stream_.panels().rows(0) <= most_rows_ && (most == 0 || stream_.panel_bytes() <= most) &&
           device_.share(std::make_shared<PageBuffer>(std::size_t{1} << 12)) != nullptr;
  }

  [[nodiscard]] std::uint32_t panels_for_the_device() const {
    const DeviceInfo& info = device_.info();
    const std::uint32_t fitting = stream_.fitting(), all = stream_.panels().panels();
    if (info.type == DeviceType::cpu) return fitting == all ? all : fitting - std::min(fitting, 2U);  // less the turns
    if (info.memory_bytes == 0) return fitting;  // not known: the device itself must refuse
    // The solver's vectors, those above, and a tenth for the driver.
    const std::uint64_t others = info.memory_bytes / 10 + 20 * vector_bytes() + 2 * turn_bytes();
    const std::uint64_t room = info.memory_bytes > others ? info.memory_bytes - others : 0;
    return static_cast<std::uint32_t>(std::min<std::uint64_t>(fitting, room / stream_.panel_bytes()));
  }

  /// visit(offset in the panel, rows) for pieces that a launch takes.
  template <class Visit>
  void cut(std::uint32_t rows, const Visit& visit) const {
    for (std::uint32_t done = 0; done < rows; done += rows_of_a_turn()) {
      visit(done, std::min(rows_of_a_turn(), rows - done));
    }
  }
  [[nodiscard]] std::span<const std::byte> bytes_of(const PanelStream::View& view, std::uint32_t offset,
                                                    std::uint32_t rows) const {
    return {view.memory->data() + offset * row_bytes(), rows * row_bytes()};
  }

  void upload_first_panels() {
    stream_.pass(
        [&](const PanelStream::View& view) {
          cut(view.rows, [&](std::uint32_t offset, std::uint32_t rows) {
            pieces_.push_back({view.first + offset, rows, uploaded(bytes_of(view, offset, rows))});
            uploaded_bytes_ += rows * row_bytes();
          });
        },
        0, on_device_);
  }

  void multiply(std::uint32_t first, std::uint32_t rows, Buffer& panel) {
    const MatvecArguments arguments{.n = form_factors_.size(),
                                    .first = first,
                                    .rows = rows,
                                    .row_stride = form_factors_.stride(),
                                    .vector_stride = shape_.vector_stride};
    const std::array buffers{&panel, scaled_.get(), sums_.get()};
    launch(multiply_kernel(), (rows + group_ - 1) / group_, buffers, arguments, "S xs");
  }

  void in_place(const PanelStream::View& view) {
    if (view.stays) {
      std::unique_ptr<Buffer>& buffer = shared_[view.panel];
      if (buffer == nullptr) buffer = device_.share(view.memory);
      multiply(view.first, view.rows, *buffer);
      return;
    }
    // Shared anew each time: a driver may look at the memory only then.
    const std::unique_ptr<Buffer> buffer = device_.share(view.memory);
    multiply(view.first, view.rows, *buffer);
    device_.queue().wait();  // before other rows are read into it
  }

  void in_turn(const PanelStream::View& view) {
    cut(view.rows, [&](std::uint32_t offset, std::uint32_t rows) {
      std::swap(turns_[0], turns_[1]);
      device_.queue().upload(*turns_[0], 0, bytes_of(view, offset, rows));
      multiply(view.first + offset, rows, *turns_[0]);
    });
  }

  const StreamedMatrix& form_factors_;
  PanelStream& stream_;
  Macros macros_;
  std::uint32_t group_;          ///< rows of a work-group
  std::uint32_t most_rows_;      ///< of a launch
  bool shares_;                  ///< the device uses the host's memory
  std::uint32_t on_device_ = 0;  ///< panels, the first ones, whose pieces lie on the device
  std::vector<Piece> pieces_;
  std::map<std::uint32_t, std::unique_ptr<Buffer>> shared_;  ///< panels that stay in the host's memory
  std::array<std::unique_ptr<Buffer>, 2> turns_;
  std::unique_ptr<Kernel> scale_;
  std::unique_ptr<Buffer> in_, out_, scaled_, sums_;
};

}  // namespace

std::unique_ptr<Product> make_product(const StreamedMatrix& form_factors, Device& device, const VectorArguments& shape,
                                      std::uint32_t groups) {
  return std::make_unique<StreamedProduct>(form_factors, device, shape, groups);
}

}  // namespace interflect
