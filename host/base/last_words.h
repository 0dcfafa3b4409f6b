#pragma once

#include <string_view>

namespace interflect {

/// What a signal that ends the process writes to stderr once its temporary files are removed
/// (remove_temporaries_on_signals()): a whole line, in memory that lives as long as it is set. Empty: nothing.
void set_last_words(std::string_view line) noexcept;

}  // namespace interflect
