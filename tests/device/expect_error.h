#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <string>

#include "interflect/base/error.h"

namespace interflect::test {

/// The action throws an Error of that kind, whose text matches.
inline void expect_error(ErrorKind kind, const testing::Matcher<std::string>& message,
                         const std::function<void()>& action) {
  try {
    action();
    FAIL() << "no error";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), kind) << error.what();
    EXPECT_THAT(std::string(error.what()), message);
  }
}

}  // namespace interflect::test
