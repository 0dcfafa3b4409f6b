#include "interflect/serve/desk.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace interflect::serve {
namespace {

using ::testing::ElementsAre;

struct Log {
  std::vector<std::string> worked;
  std::vector<int> answered;

  [[nodiscard]] Desk::Work work(const std::string& name) {
    return [this, name] {
      worked.push_back(name);
      return refusal(200, name);
    };
  }
  [[nodiscard]] Desk::Done done() {
    return [this](const Answer& answer) { answered.push_back(answer.status); };
  }
};

TEST(Desk, NewestOfAClientTakesItsPlace) {
  Desk desk(8);
  Log log;
  desk.leave("a", log.work("a1"), log.done());
  desk.leave("b", log.work("b1"), log.done());
  desk.leave("a", log.work("a2"), log.done());  // a1 is passed over, and told so
  desk.leave("", log.work("nobody 1"), log.done());
  desk.leave("", log.work("nobody 2"), log.done());
  EXPECT_THAT(log.answered, ElementsAre(409));
  desk.leave(
      "",
      [&] {
        desk.stop();
        return refusal(200, "");
      },
      log.done());
  desk.run();
  EXPECT_THAT(log.worked, ElementsAre("a2", "b1", "nobody 1", "nobody 2"));
  EXPECT_THAT(log.answered, ElementsAre(409, 200, 200, 200, 200, 200));
}

TEST(Desk, IsBoundedAndAnswersEveryone) {
  Desk desk(2);
  Log log;
  desk.leave(
      "",
      [&] {
        desk.stop();
        return refusal(200, "");
      },
      log.done());
  desk.leave("x", log.work("x"), log.done());
  desk.leave("y", log.work("y"), log.done());
  EXPECT_THAT(log.answered, ElementsAre(503));
  desk.leave("x", log.work("x2"), log.done());  // takes a place that is there
  EXPECT_THAT(log.answered, ElementsAre(503, 409));
  desk.run();
  EXPECT_THAT(log.worked, ElementsAre());  // it was told to stop before
  EXPECT_THAT(log.answered, ElementsAre(503, 409, 200, 503));
  desk.leave("z", log.work("z"), log.done());
  EXPECT_THAT(log.answered, ElementsAre(503, 409, 200, 503, 503));
}

TEST(Desk, GoesOnAfterAnException) {
  Desk desk(8);
  Log log;
  desk.leave(
      "", []() -> Answer { throw std::runtime_error("harm"); }, log.done());
  desk.leave("", log.work("next"), log.done());
  desk.leave(
      "",
      [&] {
        desk.stop();
        return refusal(200, "");
      },
      log.done());
  desk.run();
  EXPECT_THAT(log.worked, ElementsAre("next"));
  EXPECT_THAT(log.answered, ElementsAre(500, 200, 200));
}

}  // namespace
}  // namespace interflect::serve
