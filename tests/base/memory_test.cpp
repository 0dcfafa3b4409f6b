#include "interflect/base/memory.h"

#include <gtest/gtest.h>

#include <memory>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <utility>

#include "interflect/base/error.h"

namespace interflect {
namespace {

/// Sets INTERFLECT_MEMORY for a test and puts it back.
class Override {
 public:
  explicit Override(const char* value) {
    if (const char* old = std::getenv(name)) old_ = old;
    ::setenv(name, value, 1);
  }
  Override(const Override&) = delete;
  Override& operator=(const Override&) = delete;
  ~Override() {
    if (old_.empty()) {
      ::unsetenv(name);
    } else {
      ::setenv(name, old_.c_str(), 1);
    }
  }

 private:
  static constexpr const char* name = "INTERFLECT_MEMORY";
  std::string old_;
};

TEST(AvailableMemory, IsThereAndPlausible) {
  EXPECT_GT(available_memory(), std::uint64_t{1} << 20);
}

TEST(AvailableMemory, CanBeOverridden) {
  const std::pair<const char*, std::uint64_t> good[] = {
      {"0", 0}, {"123", 123}, {"2K", 2048}, {"2k", 2048}, {"3M", 3u << 20}, {"1.5G", 3u << 29}, {"4g", 1ull << 32}};
  for (const auto& [text, bytes] : good) {
    const Override set(text);
    EXPECT_EQ(available_memory(), bytes) << text;
  }
}

TEST(AvailableMemory, AnOverrideThatIsNoSizeIsAnError) {
  for (const char* bad : {"", "G", "lots", "-1", "4GB", "4 G", "nan", "inf", "1e30"}) {
    const Override set(bad);
    try {
      (void)available_memory();
      ADD_FAILURE() << "'" << bad << "' was taken";
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::usage);
      EXPECT_NE(std::string(error.what()).find("INTERFLECT_MEMORY"), std::string::npos);
    }
  }
}

TEST(PageBuffer, IsAlignedZeroAndItsOwn) {
  PageBuffer buffer(3'000'001);
  ASSERT_EQ(buffer.size(), 3'000'001u);
  EXPECT_EQ(reinterpret_cast<std::uintptr_t>(buffer.data()) % (2u << 20), 0u);
  EXPECT_TRUE(std::all_of(buffer.data(), buffer.data() + buffer.size(), [](std::byte b) { return b == std::byte{0}; }));
  buffer.data()[buffer.size() - 1] = std::byte{7};
  const std::byte* where = buffer.data();
  const PageBuffer moved = std::move(buffer);
  EXPECT_EQ(moved.data(), where);
  EXPECT_EQ(moved.data()[moved.size() - 1], std::byte{7});
  EXPECT_EQ(PageBuffer(0).data(), nullptr);
  EXPECT_EQ(PageBuffer().size(), 0u);
}

TEST(PageBuffer, APartKeepsTheWholeAlive) {
  auto whole = std::make_shared<PageBuffer>(std::size_t{1} << 16);
  whole->data()[5000] = std::byte{9};
  std::byte* const where = whole->data();
  const std::weak_ptr<PageBuffer> watch = whole;
  auto part = PageBuffer::part(std::move(whole), 4096, 1000);
  EXPECT_EQ(part->data(), where + 4096);
  EXPECT_EQ(part->size(), 1000u);
  EXPECT_EQ(part->data()[904], std::byte{9});
  EXPECT_FALSE(watch.expired());
  EXPECT_THROW(static_cast<void>(PageBuffer::part(part, 999, 2)), Error);
  EXPECT_EQ(PageBuffer::part(part, 1000, 0)->size(), 0u);
  part.reset();
  EXPECT_TRUE(watch.expired());
}

TEST(PageBuffer, WhatTheSystemRefusesIsALimit) {
  for (const std::size_t bytes : {SIZE_MAX, SIZE_MAX - (std::size_t{2} << 20), SIZE_MAX / 2}) {
    try {
      const PageBuffer buffer(bytes);
      ADD_FAILURE() << bytes;
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::limit);
    }
  }
}

}  // namespace
}  // namespace interflect
