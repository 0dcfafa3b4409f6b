#pragma once

namespace interflect::test {

/// Whether this is a build with the address sanitizer, in which some tests run smaller sizes, and say so.
#if defined(__SANITIZE_ADDRESS__)
inline constexpr bool sanitized = true;
#elif defined(__has_feature)
inline constexpr bool sanitized = __has_feature(address_sanitizer);
#else
inline constexpr bool sanitized = false;
#endif

}  // namespace interflect::test
