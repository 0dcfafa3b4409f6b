// The page as a file: what its numbers are, and that names stay text. What it shows is in tests/browser.
#include "interflect/output/html.h"

#include <gmock/gmock.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <sstream>

#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/base/half.h"
#include "interflect/output/page_parts.h"
#include "output/rooms.h"

namespace interflect {
namespace {

using nlohmann::json;
using test::Lit;
using test::SceneBuilder;
using test::TemporaryFolder;
using ::testing::HasSubstr;
using ::testing::Not;

const std::string hostile = "</script><img src=x onerror=alert(1)><!--\"'&\xff\u2028";

/// A wall and two lamps, the second with a name that means harm; made-up light, the bounces too.
struct Room {
  Lit lit;
  Room() : lit(scene(), 0.1) {
    Solution& s = lit.solution;
    const std::size_t n = lit.mesh.size();
    s.lights.names = {"left", hostile};
    s.lights.of_patch.assign(n, LightGroups::none);
    s.lit.assign(2, std::vector<Rgb>(n));
    s.bounces.assign(3, s.lit);
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t g = 0; g < 2; ++g) {
        const auto x = static_cast<double>(i + 1), y = static_cast<double>(g + 1);
        s.lit[g][i] = {1 / (x * y), std::sqrt(x) * 1e-4, 3000 * y};
        for (std::size_t k = 0; k < 3; ++k) {
          for (std::size_t c = 0; c < 3; ++c) s.bounces[k][g][i][c] = s.lit[g][i][c] * static_cast<double>(k) / 3;
        }
        for (std::size_t c = 0; c < 3; ++c) s.radiosity[i][c] += s.lit[g][i][c];
      }
      s.row_sum[i] = 1 - 0.1 / static_cast<double>(i + 1);
      if (shines(i)) s.lights.of_patch[i] = lit.mesh.centroid[i].x < 1000.5 ? 0 : 1;
    }
  }
  [[nodiscard]] bool shines(std::size_t i) const { return lit.mesh.emittance[i][0] > 0; }
  static Scene scene() {
    SceneBuilder s;
    s.quad("wall", s.material({0.1, 0.2, 0.3}), {1000, 0, 0}, {1001, 0, 0}, {1001, 1, 0}, {1000, 1, 0});
    s.quad(hostile, s.material({0.4, 0.5, 0.6}, {7, 8, 9}), {1000, 0, 1}, {1000, 1, 1}, {1001, 1, 1}, {1001, 0, 1});
    return s.scene();
  }
};

std::string page_of(const Solution& solution, const PageOptions& options = {}) {
  std::string page;
  make_page(solution, options, [&](std::string_view text) { page += text; });
  return page;
}

std::string between(const std::string& page, const std::string& start, const std::string& end) {
  const std::size_t from = page.find(start);
  EXPECT_NE(from, std::string::npos) << start;
  return page.substr(from + start.size(), page.find(end, from + start.size()) - from - start.size());
}

json description_of(const std::string& page) {
  return json::parse(between(page, "id=\"description\">", "</script>"));
}

std::string numbers_of(const std::string& page) {
  std::string out;
  std::uint32_t word = 0;
  int bits = 0;
  for (const char c : between(page, "id=\"numbers\">", "</script>")) {
    static const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    if (c == '=') break;
    word = word << 6U | static_cast<std::uint32_t>(digits.find(c));
    bits += 6;
    if (bits >= 8) out += static_cast<char>(word >> (bits -= 8) & 0xFFU);
  }
  return out;
}

template <class T>
std::vector<T> section(const json& description, const std::string& numbers, const std::string& name) {
  const json& found = description.at("sections").at(name);
  EXPECT_EQ(found.at("at").get<std::size_t>() % 4, 0U);
  std::vector<T> values(found.at("count").get<std::size_t>());
  EXPECT_LE(found.at("at").get<std::size_t>() + values.size() * sizeof(T), numbers.size());
  std::memcpy(values.data(), numbers.data() + found.at("at").get<std::size_t>(), values.size() * sizeof(T));
  return values;
}

std::size_t count(const std::string& text, const std::string& what) {
  std::size_t n = 0;
  for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; ++at) ++n;
  return n;
}

TEST(Page, HoldsTheSolutionInSinglePrecision) {
  const Room room;
  const Solution& s = room.lit.solution;
  PageOptions options;
  options.materials = {"paint", "glow"};
  const std::string page = page_of(s, options);
  const json description = description_of(page);
  const std::string numbers = numbers_of(page);
  EXPECT_EQ(description.at("patches"), room.lit.mesh.size());
  EXPECT_EQ(description.at("surfaces")[0], json({"wall", "paint"}));
  EXPECT_EQ(section<std::uint32_t>(description, numbers, "lamp"), s.lights.of_patch);
  for (std::size_t g = 0; g < 2; ++g) {
    const auto lit = section<float>(description, numbers, "lit." + std::to_string(g));
    ASSERT_EQ(lit.size(), 3 * room.lit.mesh.size());
    for (std::size_t k = 0; k < lit.size(); ++k) EXPECT_EQ(lit[k], static_cast<float>(s.lit[g][k / 3][k % 3]));
  }
  const auto sums = section<float>(description, numbers, "row_sum");
  for (std::size_t i = 0; i < sums.size(); ++i) EXPECT_EQ(sums[i], static_cast<float>(s.row_sum[i]));
  // Positions are exact enough although the room is a kilometre from the origin.
  const auto positions = section<float>(description, numbers, "positions");
  for (std::size_t k = 0; k < positions.size(); ++k) {
    const double there = static_cast<double>(positions[k]) + description.at("origin")[k % 3].get<double>();
    EXPECT_NEAR(there, room.lit.mesh.vertices[k / 3][static_cast<int>(k % 3)], 1e-7);
  }
}

/// The largest excess of a page's bounces over what html.h promises; at most 0 when all is right.
double bounce_excess(const std::string& page, const Solution& solution) {
  const json description = description_of(page);
  const std::string numbers = numbers_of(page);
  const double unit = description.at("bounce_unit");
  double excess = -1;
  for (std::size_t k = 0; k < solution.bounces.size(); ++k) {
    for (std::size_t g = 0; g < solution.bounces[k].size(); ++g) {
      const auto bits =
          section<std::uint16_t>(description, numbers, "bounce." + std::to_string(k) + "." + std::to_string(g));
      for (std::size_t j = 0; j < bits.size(); ++j) {
        const double exact = solution.bounces[k][g][j / 3][j % 3];
        const double bound = 1.001 * std::max(std::ldexp(std::abs(exact), -11), std::ldexp(unit, -25));
        excess = std::max(excess, std::abs(static_cast<double>(from_half(bits[j])) * unit - exact) - bound);
      }
    }
  }
  return excess;
}

TEST(Page, HoldsTheBouncesAsExactlyAsItSays) {
  Room room;
  Solution& s = room.lit.solution;
  const std::string page = page_of(s);
  EXPECT_LE(bounce_excess(page, s), 0);
  // The twin: a value that is off by twice the bound is noticed.
  s.bounces[2][1][0][2] *= 1 + std::ldexp(1, -9);
  EXPECT_GT(bounce_excess(page, s), 0);
}

TEST(Page, KeepsNamesAsText) {
  const Room room;
  PageOptions options;
  options.title = hostile;
  options.materials = {hostile, hostile};
  options.statistics = {{hostile, hostile}};
  const std::string page = page_of(room.lit.solution, options);
  EXPECT_EQ(count(page, "<script"), 4U);
  EXPECT_EQ(count(page, "</script"), 4U);
  EXPECT_THAT(page, Not(HasSubstr("<img")));
  const json description = description_of(page);
  const std::string shown = "</script><img src=x onerror=alert(1)><!--\"'&\ufffd\u2028";
  EXPECT_EQ(description.at("title"), shown);
  EXPECT_EQ(description.at("lamps")[1], shown);
  EXPECT_EQ(description.at("surfaces")[1], json({shown, shown}));
}

TEST(Page, AllowsItselfNothingButItsOwnScripts) {
  const Room room;
  const std::string policy = between(page_of(room.lit.solution), "Content-Security-Policy\" content=\"", "\"");
  EXPECT_THAT(policy, HasSubstr("default-src 'none';"));
  EXPECT_EQ(count(policy, "'sha256-"), 3U);
  EXPECT_THAT(policy, Not(HasSubstr("unsafe")));
  EXPECT_THAT(policy, Not(HasSubstr("connect-src")));
  PageOptions served;
  served.served = true;
  EXPECT_THAT(page_of(room.lit.solution, served), HasSubstr("connect-src 'self';"));
}

TEST(Page, SaysWhereBouncesAreMissing) {
  const Room room;
  PageOptions options;
  EXPECT_FALSE(description_of(page_of(room.lit.solution, options)).contains("incomplete"));
  options.complete = false;
  EXPECT_EQ(description_of(page_of(room.lit.solution, options)).at("incomplete"), true);
}

TEST(Page, HasTheLicenceOfWhatItHolds) {
  const Room room;
  EXPECT_THAT(page_of(room.lit.solution),
              ::testing::AllOf(HasSubstr("three.js authors"), HasSubstr("MERCHANTABILITY")));
}

TEST(Page, OfASolutionWithoutGroupsHasOneLamp) {
  Room room;
  Solution& s = room.lit.solution;
  s.lights = {};
  s.lit.clear();
  for (auto& bounce : s.bounces) bounce.pop_back();
  s.radiosity[0] = {std::nan(""), 1, std::numeric_limits<double>::infinity()};
  const std::string page = page_of(s);
  const json description = description_of(page);
  EXPECT_EQ(description.at("lamps"), json::array({"All lamps"}));
  EXPECT_EQ(description.at("bounces"), 3);
  EXPECT_LE(bounce_excess(page, s), 0);
  const auto lit = section<float>(description, numbers_of(page), "lit.0");
  EXPECT_TRUE(std::isnan(lit[0]));
  EXPECT_EQ(lit[1], 1.0F);
  EXPECT_TRUE(std::isnan(lit[2]));  // not the largest number, which would be white
  for (std::size_t k = 3; k < lit.size(); ++k) EXPECT_EQ(lit[k], static_cast<float>(s.radiosity[k / 3][k % 3]));
}

TEST(Page, LeavesOutBouncesThatWouldMakeItTooLarge) {
  const Room room;
  PageOptions options;
  options.largest_bounces = 6 * 3 * 2 * room.lit.mesh.size();
  EXPECT_EQ(description_of(page_of(room.lit.solution, options)).at("bounces"), 3);
  --options.largest_bounces;
  const json description = description_of(page_of(room.lit.solution, options));
  EXPECT_EQ(description.at("bounces"), 0);
  EXPECT_THAT(description.at("bounces_left_out").get<std::string>(), HasSubstr("3 bounces of 2 lamps"));
}

TEST(Page, RefusesASolutionWhosePartsDoNotFit) {
  const auto refused = [](const std::function<void(Solution&)>& spoil) {
    Room room;
    spoil(room.lit.solution);
    EXPECT_THROW((void)page_of(room.lit.solution), Error);
  };
  refused([](Solution& s) { s.radiosity.pop_back(); });
  refused([](Solution& s) { s.lit.pop_back(); });
  refused([](Solution& s) { s.lit[1].pop_back(); });
  refused([](Solution& s) { s.lights.of_patch.pop_back(); });
  refused([](Solution& s) { s.bounces[1].pop_back(); });
  refused([](Solution& s) { s.bounces[1][1].pop_back(); });
  refused([](Solution& s) { s.lights = {}, s.lit.clear(); });
}

TEST(PageParts, FitTogether) {
  EXPECT_EQ(page_parts().size(), 5U);
  for (const PagePart& part : page_parts()) {
    EXPECT_EQ(part.sha256.size(), 64U);
    EXPECT_EQ(text_of(part).size(), part.size);
    PagePart cut = part;
    cut.packed = cut.packed.first(cut.packed.size() - 20);
    EXPECT_THROW((void)text_of(cut), Error);
  }
  EXPECT_THROW((void)page_part("missing"), Error);
}

}  // namespace
}  // namespace interflect
