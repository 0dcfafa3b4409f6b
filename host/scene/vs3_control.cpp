#include "interflect/scene/vs3_control.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <optional>

#include "interflect/scene/obj_material.h"
#include "interflect/scene/statements.h"
#include "interflect/scene/text.h"

namespace interflect::vs3 {

namespace {

std::string lower(std::string_view text) {
  std::string out(text);
  std::transform(out.begin(), out.end(), out.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return out;
}

/// Takes the words of a line apart at "=" as well.
class Pairs {
 public:
  explicit Pairs(Words& in) : in_(in) {}
  std::string_view next() {
    while (true) {
      const std::size_t first = rest_.find_first_not_of('=');
      if (first != std::string_view::npos) {
        rest_.remove_prefix(first);
        const std::string_view taken = rest_.substr(0, rest_.find('='));
        rest_.remove_prefix(taken.size());
        return taken;
      }
      rest_ = in_.word();
      if (rest_.empty()) return {};
    }
  }

 private:
  Words& in_;
  std::string_view rest_;
};

}  // namespace

void Control::read(Words& in) {
  constexpr std::array<std::string_view, 5> accuracy{"eps", "maxu", "maxo", "mino", "prjd"};
  constexpr std::array<std::string_view, 7> known{"list", "out", "maxv", "encl", "emit", "row", "col"};
  Pairs pairs(in);
  for (std::string_view word = pairs.next(); !word.empty(); word = pairs.next()) {
    const std::string name = lower(word);
    const bool integrates = std::find(accuracy.begin(), accuracy.end(), name) != accuracy.end();
    const std::string_view text = pairs.next();
    if (!integrates && std::find(known.begin(), known.end(), name) == known.end()) {
      if (unknown_.size() < 20) unknown_.insert(one_line(name));
      continue;
    }
    const std::optional<double> value = finite_number(text);
    if (!value) in.fail(fmt::format("{}: '{}' is not a finite number", name, one_line(text)));
    if (name != "eps" && !whole_number(text)) {
      in.fail(fmt::format("{}: '{}' is not a whole number in range", name, one_line(text)));
    }
    if (integrates) accuracy_.insert(name);
    enclosure_ = enclosure_ || (name == "encl" && *value != 0);
    script_f_ = script_f_ || (name == "emit" && *value != 0);
    part_ = part_ || ((name == "row" || name == "col") && *value > 0);
  }
}

void Control::report(std::vector<std::string>& warnings) const {
  const auto warn = [&](const std::string& text) { add_warning(warnings, fmt::format("{}: {}", file_, text)); };
  if (!unknown_.empty()) warn(fmt::format("control words that are not known: {}", fmt::join(unknown_, ", ")));
  if (!accuracy_.empty()) {
    warn(fmt::format("View3D's settings of its integration are not used: {}", fmt::join(accuracy_, ", ")));
  }
  if (enclosure_) warn("encl=1: the geometry decides whether the scene is closed; --closure on forces row sums of 1");
  if (script_f_) warn("emit=1: the factors stay view factors; the emittances become reflectances");
  if (part_) warn("row and col: all factors are computed");
}

}  // namespace interflect::vs3
