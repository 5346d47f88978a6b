// What may name a label in every file format and page on the way.
#include "pipeline/contract/label_name.hpp"

#include <gtest/gtest.h>

namespace viscera {
namespace {

// What is said of this name, or "allowed".
std::string said(const std::string& name) {
  try {
    check_label_name(name, ExitCode::bad_input, "mesh.vtu", "label_names");
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::bad_input);
    EXPECT_EQ(e.problem().where, "mesh.vtu");
    EXPECT_EQ(e.problem().field, "label_names");
    return e.problem().found.substr(0, e.problem().found.find(':'));
  }
  return "allowed";
}

TEST(LabelName, LettersOfAnyLanguageQuotesAndBracketsAreAllowedUpToTheLongestName) {
  for (const std::string& name :
       {std::string("liver"), std::string("L\xc3\xa4sion"), std::string("\xc2\xa0x"),
        std::string("a \\ \"b\" [c] {d}"), std::string(max_label_name, 'a')}) {
    EXPECT_EQ(said(name), "allowed") << name;
  }
  EXPECT_EQ(said(std::string(max_label_name + 1, 'a')), "a name of 101 bytes");
  EXPECT_EQ(said(""), "an empty name");
  EXPECT_EQ(said("liv\xe4r"), "a name that is not UTF-8");
}

TEST(LabelName, AControlCharacterIsRefusedWhereverItStands) {
  for (const std::string control : {"\x01", "\n", "\x1f", "\x7f", "\xc2\x80", "\xc2\x9f"}) {
    for (const std::string& name : {control + "liver", "li" + control + "ver", "liver" + control}) {
      EXPECT_EQ(said(name), "a name with a control character") << name;
    }
  }
}

TEST(LabelName, ABlankIsRefusedAtEitherEndOnly) {
  EXPECT_EQ(said("left lobe"), "allowed");
  EXPECT_EQ(said(" liver"), "a name with a blank at its end");
  EXPECT_EQ(said("liver "), "a name with a blank at its end");
}

}  // namespace
}  // namespace viscera
