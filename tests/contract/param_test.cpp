#include "pipeline/base/param.hpp"

#include <gtest/gtest.h>

#include "pipeline/base/error.hpp"
#include "pipeline/base/json_value.hpp"

namespace viscera {
namespace {

const std::vector<Param> declared = {
    {.name = "cell_size",
     .type = ParamType::real,
     .fallback = "5mm",
     .unit = "mm",
     .lo = 0.1,
     .hi = 100.0,
     .doc = "edge"},
    {.name = "iterations", .type = ParamType::integer, .fallback = 3, .lo = 1.0, .doc = "n"},
    {.name = "device",
     .type = ParamType::text,
     .fallback = "auto",
     .choices = {"auto", "cpu", "cuda"},
     .doc = "where"},
    {.name = "labels", .type = ParamType::map, .fallback = nullptr, .doc = "names"},
    {.name = "sizes",
     .type = ParamType::map,
     .fallback = Json::object(),
     .entry = {quantity("", nullptr, "mm", 0.1, 100.0, "edge there")},
     .doc = "cell sizes of labels"},
    {.name = "materials",
     .type = ParamType::map,
     .fallback = Json::object(),
     .entry = {quantity("E", nullptr, "Pa", 1.0, 1e9, "stiffness"),
               {.name = "law", .fallback = ""}},
     .doc = "by label"},
};

TEST(Param, DefaultsAndGivenValuesResolveToTheDeclaredUnitAndOrder) {
  const Json resolved = resolve(declared, Json{{"cell_size", "0.4cm"}}, "spec.yaml");
  EXPECT_DOUBLE_EQ(resolved["cell_size"].get<double>(), 4.0);
  EXPECT_EQ(resolved["iterations"], 3);
  EXPECT_TRUE(resolved["labels"].is_null());
  EXPECT_EQ(resolved.begin().key(), "cell_size");
}

TEST(Param, AMisspeltNameIsRefusedWithTheNearestValidOne) {
  try {
    resolve(declared, Json{{"cel_size", "4mm"}}, "spec.yaml:7:3", "tetmesh.");
    FAIL();
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::bad_config);
    EXPECT_EQ(e.problem().field, "tetmesh.cel_size");
    EXPECT_NE(std::string(e.what()).find("'cell_size'"), std::string::npos) << e.what();
    EXPECT_NE(std::string(e.what()).find("spec.yaml:7:3"), std::string::npos);
  }
}

TEST(Param, WhatTheValuesOfAMapAreIsCheckedWhereTheirPlaceIsKnown) {
  const Json right{{"sizes", {{"liver", "4 mm"}}}, {"materials", {{"liver", {{"E", "5 kPa"}}}}}};
  const Json resolved = resolve(declared, right, "spec.yaml");
  EXPECT_EQ(resolved["sizes"], right["sizes"]) << "given on as it was written, with its unit";
  EXPECT_EQ(resolved["materials"], right["materials"]);
  const std::vector<std::pair<Json, std::string>> wrong = {
      {{{"sizes", {{"liver", nullptr}}}}, "sizes.liver"},
      {{{"sizes", {{"liver", "4"}}}}, "sizes.liver"},
      {{{"sizes", {{"liver", "4 m"}}}}, "sizes.liver"},
      {{{"materials", {{"liver", nullptr}}}}, "materials.liver"},
      {{{"materials", {{"liver", {{"e", "5 kPa"}}}}}}, "materials.liver.e"},
      {{{"materials", {{"liver", {{"E", "5 mm"}}}}}}, "materials.liver.E"}};
  for (const auto& [given, field] : wrong) {
    try {
      resolve(declared, given, "spec.yaml:7:3", "tetmesh.");
      ADD_FAILURE() << given;
    } catch (const Error& e) {
      EXPECT_EQ(e.code(), ExitCode::bad_config);
      EXPECT_EQ(e.problem().where, "spec.yaml:7:3") << given;
      EXPECT_EQ(e.problem().field, "tetmesh." + field) << given;
    }
  }
}

// Up to a third of a name may be wrong: more letters in a long name than in a short one.
TEST(Param, AMisspeltNameIsGuessedAsFarAsAThirdOfItsLetters) {
  EXPECT_EQ(nearest("cell_size_mm", {"cell_size", "device"}), "cell_size");
  EXPECT_EQ(nearest("size", {"device", "labels"}), "");
}

TEST(Param, OutOfRangeWrongTypeAndUnknownChoiceAreRefused) {
  for (const Json& given :
       {Json{{"cell_size", "0mm"}}, Json{{"cell_size", "1m"}}, Json{{"cell_size", true}},
        Json{{"iterations", 1.5}}, Json{{"iterations", 0}}, Json{{"device", "gpu"}},
        Json{{"labels", "liver"}}}) {
    EXPECT_THROW(resolve(declared, given, "spec.yaml"), Error) << given;
  }
}

TEST(Param, ABoundItselfIsAllowed) {
  for (const Json& given : {Json{{"cell_size", "0.1mm"}}, Json{{"cell_size", "100mm"}},
                            Json{{"cell_size", "10cm"}}, Json{{"iterations", 1}}}) {
    EXPECT_NO_THROW(resolve(declared, given, "spec.yaml")) << given;
  }
}

TEST(Param, CommandLineTextReadsAsNumbersListsAndMaps) {
  EXPECT_EQ(value_from_text("5mm"), "5mm");
  EXPECT_EQ(value_from_text("12"), 12);
  EXPECT_EQ(value_from_text("true"), true);
  EXPECT_TRUE(value_from_text("null").is_null());
  EXPECT_TRUE(value_from_text("~").is_null());
  EXPECT_EQ(value_from_text("{liver: 1, tumour: [2, 3]}"),
            (Json{{"liver", 1}, {"tumour", Json::array({2, 3})}}));
  EXPECT_THROW(value_from_text("{liver: "), Error);
}

TEST(Param, AnyTextSurvivesTheCommandLineWhenQuotedAsJson) {
  for (const std::string text : {"[draft] liver", "", "12", "true", "a \"b\" \n c", "ü"}) {
    EXPECT_EQ(value_from_text(Json(text).dump()), Json(text)) << text;
  }
}

TEST(Param, AWholeNumberMayHaveAPoint) {
  const auto& iterations = declared[1];
  EXPECT_EQ(resolve_value(iterations, 16.0, "a", "b").dump(), "16");
  for (const Json& other : {Json(16.5), Json(1e300), Json("16")})
    EXPECT_THROW(resolve_value(iterations, other, "a", "b"), Error);
}

TEST(Param, ADeclarationSurvivesTheWayThroughDescribe) {
  for (const auto& param : declared) {
    const Json json = to_json(param);
    EXPECT_EQ(to_json(param_from_json({json, "describe"})), json);
  }
}

TEST(Param, AValueThatIsNotUtf8IsRefusedAsOne) {
  try {
    value_from_text("liv\xe4r");
    FAIL();
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::bad_config);
    EXPECT_NE(std::string(e.what()).find("--set: a value that is not UTF-8"), std::string::npos);
  }
}

}  // namespace
}  // namespace viscera
