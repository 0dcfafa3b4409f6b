// The drawings of `bench --plot`, from rows that are there already.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <pugixml.hpp>
#include <set>

#include "program.h"

namespace interflect::test {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using Json = nlohmann::ordered_json;

/// Rows of every kind on two devices, one of them with a name that no XML may hold as it is.
Json rows() {
  Json all = Json::array();
  for (const char* device : {"openmp", "gpu<&\"'>:0"}) {
    const auto add = [&](const char* what, unsigned n, const char* scene, const char* storage, double seconds) {
      const bool measured = seconds > 0;
      all.push_back(
          {{"device", device},
           {"what", what},
           {"scene", scene},
           {"storage", storage},
           {"n", n},
           {"columns", 3},
           {"seconds", seconds},
           {"seconds_min", 0.9 * seconds},
           {"seconds_max", 1.5 * seconds},
           {"bytes", n == 0 ? 100000000 : 4ULL * n * n},
           {"flops", n == 0 ? 0 : 6ULL * n * n},
           {"ceiling_gb_per_s", std::string(what) == "cg_step" || std::string(what) == "matvec" ? Json(20.0) : Json()},
           {"products", 1},
           {"status", measured ? "pass" : "unsupported"},
           {"reason", measured ? "" : "too <large>"}});
    };
    add("read", 0, "", "", 0.01);
    add("copy", 0, "", "", 0.02);
    add("launch", 0, "", "", 1e-5);
    add("cg_step", 32768, "", "", 0.03);
    add("upload", 1312, "room-1312", "sym16", 0.001);
    add("compile", 1312, "room-1312", "sym16", 0.1);
    add("matvec", 1312, "room-1312", "sym16", 1e-4);
    add("matvec", 9680, "room-9680", "dense32", 0);
    add("solve:cg", 1312, "room-1312", "sym16", 0.002);
    for (const unsigned n : {1000U, 2000U, 4000U}) add("growth", n, "room-1312", "dense32", 1e-9 * n * n);
  }
  return all;
}

std::string drawn(const Json& all, const std::string& name) {
  const Folder folder;
  const Json run{{"header", {{"interflect", "0.1.0"}, {"repetitions", 3}, {"compiler", "</style><script>"}}},
                 {"rows", all}};
  const Outcome outcome =
      run_program({"bench", "--from", folder.write("run.json", run.dump()), "--plot", folder.file(name)});
  EXPECT_EQ(outcome.status, 0) << outcome.err;
  return content_of(folder.file(name));
}

/// What makes a text no XML: mismatched tags, raw characters, a name of an attribute twice. pugixml lets some through,
/// so that tags and references are counted here too.
std::string fault(const std::string& text) {
  pugi::xml_document document;
  const pugi::xml_parse_result result = document.load_string(text.c_str(), pugi::parse_full);
  if (!result) return result.description();
  std::size_t at = 0;
  while ((at = text.find('&', at)) != std::string::npos) {
    const std::string name = text.substr(at + 1, text.find(';', at) - at - 1);
    if (!std::set<std::string>{"amp", "lt", "gt", "quot", "apos"}.contains(name)) return "a bare &";
    ++at;
  }
  return "";
}

/// How many elements of that name there are.
std::size_t elements(const pugi::xml_node& node, const std::string& name) {
  std::size_t count = node.name() == name ? 1 : 0;
  for (const pugi::xml_node& child : node.children()) count += elements(child, name);
  return count;
}

class Plot : public ::testing::TestWithParam<std::string> {};

TEST_P(Plot, IsWellFormedAndNeedsNothingFromElsewhere) {
  const std::string text = drawn(rows(), GetParam());
  EXPECT_EQ(fault(text), "");
  EXPECT_NE(fault(text.substr(0, text.size() - 3)), "");  // the check can fail
  EXPECT_NE(fault("<a>a & b</a>"), "");
  pugi::xml_document document;
  ASSERT_TRUE(document.load_string(text.c_str()));
  for (const char* name : {"script", "image", "img", "link", "use", "iframe", "object"}) {
    EXPECT_EQ(elements(document, name), 0U) << name;
  }
  for (const char* reference : {"href", "src=", "url(", "@import", "@font-face", "onload"}) {
    EXPECT_THAT(text, Not(HasSubstr(reference)));
  }
  // Names of namespaces are the only addresses.
  for (std::size_t at = text.find("://"); at != std::string::npos; at = text.find("://", at + 1)) {
    EXPECT_EQ(text.substr(at - 4, 17), "http://www.w3.org");
  }
  EXPECT_THAT(text, HasSubstr("prefers-color-scheme:dark"));
}

/// The texts of all elements, in order.
void collect(const pugi::xml_node& node, std::vector<std::string>& texts) {
  if (node.type() == pugi::node_pcdata) texts.emplace_back(node.value());
  for (const pugi::xml_node& child : node.children()) collect(child, texts);
}

TEST_P(Plot, HasEveryRowInItsTableAndEveryVerifiedOneInADrawing) {
  pugi::xml_document document;
  ASSERT_TRUE(document.load_string(drawn(rows(), GetParam()).c_str()));
  std::vector<std::string> texts;
  collect(document, texts);
  const auto count = [&](const std::string& text) { return std::count(texts.begin(), texts.end(), text); };
  EXPECT_EQ(count("unsupported: too <large>"), 2);
  EXPECT_EQ(count("pass"), static_cast<std::ptrdiff_t>(rows().size()) - 2);
  // Tooltips: device, what, scene, storage.
  for (const std::string device : {"openmp", "gpu<&\"'>:0"}) {
    for (const char* mark :
         {"launch: ", "cg_step, n = 32768: ", "upload room-1312 sym16: ", "compile room-1312 sym16: ",
          "matvec room-1312 sym16, n = 1312: ", "solve:cg room-1312 sym16: "}) {
      const auto found = std::count_if(texts.begin(), texts.end(),
                                       [&](const std::string& text) { return text.starts_with(device + " " + mark); });
      EXPECT_EQ(found, 1) << device << " " << mark;
    }
    const auto growth = std::count_if(texts.begin(), texts.end(), [&](const std::string& text) {
      return text.starts_with(device + " dense32 growth, n = ");
    });
    EXPECT_EQ(growth, 6);  // three sizes, time and bytes
  }
  EXPECT_EQ(std::count_if(texts.begin(), texts.end(),
                          [](const std::string& text) { return text.find("n^2.00") != std::string::npos; }),
            2);
}

TEST_P(Plot, IsWellFormedWithoutAnyRow) {
  EXPECT_EQ(fault(drawn(Json::array(), GetParam())), "");
}

INSTANTIATE_TEST_SUITE_P(Files, Plot, ::testing::Values("p.html", "p.svg"),
                         [](const auto& test) { return test.param == "p.svg" ? "Svg" : "Html"; });

}  // namespace
}  // namespace interflect::test
