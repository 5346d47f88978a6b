// JSON of strangers: what is missing, of another type or too deep is an error that names its place.
#include "pipeline/base/json_value.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <functional>

namespace viscera {
namespace {

// What is said of reading `text` so, or "read".
std::string said(const std::string& text, const std::function<void(const JsonValue&)>& read) {
  const JsonText json(text, "a.json");
  try {
    read(json.root());
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::bad_input);
    EXPECT_FALSE(e.problem().remedy.empty());
    return fmt::format("{}: {}: {} | {}", e.problem().where, e.problem().field, e.problem().found,
                       e.problem().allowed);
  }
  return "read";
}

TEST(JsonValue, GivesWhatIsThereByItsType) {
  const JsonText json(
      R"({"list": [1, 2.5], "text": "a", "flag": true, "none": null, "map": {"b": "c"}})",
      "a.json");
  const JsonValue root = json.root();
  EXPECT_EQ(root["list"][0].whole<int>(), 1);
  EXPECT_EQ(root["list"].items()[1].number(), 2.5);
  EXPECT_EQ(root["text"].text(), "a");
  EXPECT_TRUE(root["flag"].flag());
  EXPECT_FALSE(root.find("none"));
  EXPECT_FALSE(root.find("absent"));
  EXPECT_EQ(root["map"].texts_by_name().at("b"), "c");
  EXPECT_EQ(root["map"].members()[0].first, "b");
}

TEST(JsonValue, NamesThePlaceOfWhatIsMissingOrOfAnotherType) {
  const std::string text = R"({"runs": [{"name": 7}], "ms": "fast"})";
  const auto name = [](const JsonValue& json) { json["runs"][0]["name"].text(); };
  EXPECT_EQ(said(text, name), "a.json: runs[0].name: 7 | a text");
  EXPECT_EQ(said("[]", name), "a.json: : [] | an object");
  EXPECT_EQ(said(R"({"runs": []})", name), "a.json: runs: [] | a list of at least 1 items");
  EXPECT_EQ(said("{}", name), "a.json: runs: missing | ");
  EXPECT_EQ(said(text, [](const JsonValue& json) { json["ms"].number(); }),
            "a.json: ms: \"fast\" | a number");
  EXPECT_EQ(said(text, [](const JsonValue& json) { json["ms"].flag(); }),
            "a.json: ms: \"fast\" | true or false");
  EXPECT_EQ(said(text, [](const JsonValue& json) { json["ms"].members(); }),
            "a.json: ms: \"fast\" | an object");
  EXPECT_EQ(said(text, [](const JsonValue& json) { json["runs"].texts(); }),
            "a.json: runs[0]: {\"name\":7} | a text");
  for (const std::string none : {"{}", "{\"a\":1}", "7", "\"a\""}) {
    EXPECT_EQ(said(none, [](const JsonValue& json) { json.items(); }),
              "a.json: : " + none + " | a list");
  }
}

TEST(JsonValue, TakesNoNumberThatDoesNotFit) {
  const auto whole = [](const JsonValue& json) { json["n"].whole<int>(); };
  const auto bytes = [](const JsonValue& json) { json["n"].whole<std::uintmax_t>(); };
  EXPECT_EQ(said(R"({"n": -2147483648})", whole), "read");
  EXPECT_EQ(said(R"({"n": 2147483648})", whole), "a.json: n: 2147483648 | a whole number");
  EXPECT_EQ(said(R"({"n": 18446744073709551615})", bytes), "read");
  EXPECT_EQ(said(R"({"n": -1})", bytes), "a.json: n: -1 | a whole number");
  EXPECT_EQ(said(R"({"n": 1.5})", whole), "a.json: n: 1.5 | a whole number");
}

TEST(JsonText, IsReadToABoundedDepthAndNeverThrows) {
  const auto is_json = [](const std::string& text) {
    return !JsonText(text, "a.json").root().raw().is_discarded();
  };
  const auto nested = [](int levels) {
    return std::string(levels, '[') + std::string(levels, ']');
  };
  EXPECT_TRUE(is_json(nested(max_json_depth)));
  EXPECT_FALSE(is_json(nested(max_json_depth + 1)));
  EXPECT_FALSE(is_json(nested(200000)));
  EXPECT_FALSE(is_json("{\"a\": "));
  const std::string brackets(100, '[');  // within a text they do not count
  const JsonText text("{\"a\": \"\\\"" + brackets + "\"}", "a.json");
  EXPECT_EQ(text.root()["a"].text(), "\"" + brackets);
}

TEST(JsonValue, ShowsLittleOfWhatIsLongAndSaysWhatIsNoJson) {
  const auto text = [](const JsonValue& json) { json.text(); };
  EXPECT_LT(said("[" + std::string(5000, '1') + "]", text).size(), 200u);
  for (const std::string& none : {std::string(), std::string("{"), std::string(100, '[')}) {
    EXPECT_EQ(said(none, text), "a.json: : not JSON, or nested deeper than 64 levels | a text");
  }
}

}  // namespace
}  // namespace viscera
