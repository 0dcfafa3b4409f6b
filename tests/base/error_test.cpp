#include "interflect/base/error.h"

#include <gtest/gtest.h>

#include <string>

namespace interflect {
namespace {

TEST(Error, KindsHaveTheirExitStatus) {
  EXPECT_EQ(exit_status(ErrorKind::internal), 1);
  EXPECT_EQ(exit_status(ErrorKind::usage), 2);
  EXPECT_EQ(exit_status(ErrorKind::input), 3);
  EXPECT_EQ(exit_status(ErrorKind::device), 4);
  EXPECT_EQ(exit_status(ErrorKind::not_converged), 5);
  EXPECT_EQ(exit_status(ErrorKind::limit), 6);
}

TEST(Error, InputErrorsNameFileLineAndCause) {
  const Error with_line = input_error("room.obj", 12, "no such vertex");
  EXPECT_EQ(with_line.kind(), ErrorKind::input);
  EXPECT_STREQ(with_line.what(), "room.obj:12: no such vertex");
  EXPECT_STREQ(input_error("room.obj", 0, "is empty").what(), "room.obj: is empty");
}

TEST(Error, DeviceErrorsNameDeviceOperationAndCause) {
  const Error error = device_error("vulkan:0", "allocate", "out of memory");
  EXPECT_EQ(error.kind(), ErrorKind::device);
  EXPECT_STREQ(error.what(), "vulkan:0: allocate: out of memory");
}

TEST(Error, MessagesStayOnOneLineWhateverTheFileHolds) {
  const std::string hostile = "a\nb\r\t\x1b[31m\x7f" + std::string(1, '\0') + std::string(100000, 'x');
  for (const Error& error : {input_error(hostile, 3, hostile), device_error(hostile, hostile, hostile)}) {
    const std::string message = error.what();
    for (const char c : message) {
      ASSERT_GE(static_cast<unsigned char>(c), 0x20);
      ASSERT_NE(c, '\x7f');
    }
    EXPECT_LT(message.size(), 2000u);
    EXPECT_EQ(message.substr(0, 3), "a?b");
  }
}

}  // namespace
}  // namespace interflect
