#include "pipeline/record/page.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>

namespace viscera::engine {
namespace {

// A text as Markdown shows it: no markup, no line breaks. Bold of our own tables stays plain.
std::string plain(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '<') {
      out += "&lt;";
    } else if (c == '\n' || c == '\r') {
      out += ' ';
    } else if (c == '|' || c == '*' || c == '_' || c == '`' || c == '[' || c == ']' || c == '\\') {
      out += '\\';
      out += c;
    } else {
      out += c;
    }
  }
  return out;
}

std::string joined_plainly(const Json& texts) {
  std::string all;
  for (const auto& text : texts) all += (all.empty() ? "" : ", ") + plain(text.get<std::string>());
  return all;
}

std::string shown(const Json& value) {
  if (value.is_null()) return "–";
  if (value.is_string()) return plain(value.get<std::string>());
  if (value.is_number_float()) return fmt::format("{:.6g}", value.get<double>());
  if (value.is_array() && std::ranges::all_of(value, &Json::is_string))
    return joined_plainly(value);
  return plain(value.dump());
}

// A row for each object, a column for each of the members named.
std::string table(const Json& rows,
                  const std::vector<std::pair<const char*, const char*>>& columns) {
  std::string head = "|", line = "|", body;
  for (const auto& [member, title] : columns) {
    head += fmt::format(" {} |", title);
    line += "---|";
  }
  for (const auto& row : rows) {
    body += "|";
    for (const auto& [member, title] : columns)
      body += fmt::format(" {} |", shown(row.value(member, Json())));
    body += "\n";
  }
  return head + "\n" + line + "\n" + body + "\n";
}

std::string list(const Json& texts) {
  std::string items;
  for (const auto& text : texts) items += fmt::format("- {}\n", shown(text));
  return items + "\n";
}

std::string head_of(const Json& record) {
  const Json& run = record["run"];
  std::string text = fmt::format("# Record of the run {}\n\n", shown(run["name"]));
  text += fmt::format(
      "Outcome: **{}** ({} quality gates passed, {} failed). Started {}; stages: {}. Written by "
      "viscera {}. Not for clinical use.\n\n",
      run["state"].get<std::string>(), run["gates_passed"].dump(), run["gates_failed"].dump(),
      shown(run["started"]), shown(run["stages"]), record["viscera"].get<std::string>());
  return text + list(run["messages"]);
}

std::string methods_part(const Json& methods) {
  std::string text = "## Methods\n\n" + methods["paragraph"].get<std::string>() + "\n\n";
  int number = 0;
  for (const auto& source : methods["sources"])
    text += fmt::format("[{}] {}  \n", ++number, source.get<std::string>());
  return text + "\n";
}

std::string error_bar_part(const Json& bar) {
  std::string text = "## Error bar\n\n";
  if (bar["state"] != "known") {
    return text + fmt::format("Discretisation error: {}{}.\n\n", shown(bar["state"]),
                              bar.contains("why") ? ", since " + shown(bar["why"]) : "");
  }
  Json rows = Json::array();
  for (const auto& [name, value] : bar.items()) {
    if (name == "state" || name == "unit") continue;
    rows.push_back({{"part", name},
                    {"value", value},
                    {"unit", name == "total_share" ? Json("1") : bar["unit"]}});
  }
  return text + table(rows, {{"part", "Part"}, {"value", "Error at rest"}, {"unit", "Unit"}});
}

std::string credibility_part(const Json& record) {
  std::string text =
      "## Credibility\n\nIn the order of the credibility factors of ASME V&V 40 (2018).\n\n";
  std::string activity, group;
  for (const auto& factor : record["credibility"]) {
    if (factor["activity"] != activity)
      text += "### " + (activity = factor["activity"].get<std::string>()) + "\n\n";
    text += fmt::format("**{}: {}** – {}\n\n", shown(factor["group"]), shown(factor["factor"]),
                        shown(factor["state"]));
    text += list(factor["statements"]);
  }
  return text;
}

std::string evidence_part(const Json& record) {
  std::string text;
  if (!record["verification_rows"].empty()) {
    text += "## Verification problems that concern this run\n\n";
    text += table(record["verification_rows"], {{"subject", "Subject"},
                                                {"case", "Case"},
                                                {"solver", "Solver"},
                                                {"outcome", "Outcome"},
                                                {"figures", "Figures (bound)"},
                                                {"differs", "Differs from the run"},
                                                {"table", "Table"},
                                                {"dated", "Figures of"}});
  }
  if (!record["error_bar_rows"].empty()) {
    text += "## The error bar where the truth is known\n\n";
    text += table(record["error_bar_rows"], {{"body", "Body"},
                                             {"tets", "Tetrahedra"},
                                             {"nu", "Poisson's ratio"},
                                             {"total_percent", "Error bar, %"},
                                             {"true_percent", "True error, %"},
                                             {"effectivity", "Ratio"}});
  }
  if (!record["measured_rows"].empty()) {
    text += "## Comparison with measured bodies\n\n";
    text += table(record["measured_rows"], {{"case", "Case"},
                                            {"body", "Body"},
                                            {"state", "State"},
                                            {"quantity", "Quantity"},
                                            {"solver", "Solver"},
                                            {"error", "Error"},
                                            {"allowed", "Allowed"},
                                            {"uncertainty", "The measurement's own"},
                                            {"unit", "Unit"},
                                            {"figures", "Figures (bound)"},
                                            {"table", "Table"}});
  }
  return text;
}

std::string pictures_part(const std::vector<std::string>& pictures) {
  std::string text;
  for (const auto& picture : pictures) text += fmt::format("![{0}]({0})\n\n", picture);
  return text;
}

}  // namespace

std::string record_page(const Json& record, const std::vector<std::string>& pictures) {
  std::string text = head_of(record) + methods_part(record["methods"]) +
                     error_bar_part(record["error_bar"]) + "## Limits\n\n" +
                     list(record["methods"]["limits"]) + credibility_part(record) +
                     evidence_part(record);
  text += "## Results\n\n" +
          table(record["results"],
                {{"stage", "Stage"}, {"name", "Quantity"}, {"value", "Value"}, {"unit", "Unit"}});
  text += "## Quality gates\n\n" + table(record["gates"], {{"stage", "Stage"},
                                                           {"name", "Gate"},
                                                           {"value", "Value"},
                                                           {"comparison", ""},
                                                           {"limit", "Limit"},
                                                           {"unit", "Unit"},
                                                           {"passed", "Passed"}});
  if (!record["scene"].empty()) {
    text += "## Scene (SI)\n\n" + table(record["scene"], {{"name", "Parameter"},
                                                          {"value", "Value"},
                                                          {"unit", "Unit"},
                                                          {"origin", "Origin"},
                                                          {"where", "Where"}});
  }
  text += "## Parameters of the stages\n\n" + table(record["parameters"], {{"stage", "Stage"},
                                                                           {"name", "Parameter"},
                                                                           {"value", "Value"},
                                                                           {"unit", "Unit"},
                                                                           {"chosen", "Chosen"},
                                                                           {"origin", "Origin"},
                                                                           {"where", "Where"},
                                                                           {"meaning", "Meaning"}});
  text +=
      "## Versions\n\n" + table(record["versions"], {{"stage", "Stage"},
                                                     {"version", "Version"},
                                                     {"device", "Device"},
                                                     {"program_sha256", "SHA-256 of the program"},
                                                     {"libraries", "Libraries"}});
  const std::vector<std::pair<const char*, const char*>> file_columns = {
      {"stage", "Stage"}, {"name", "File"}, {"bytes", "Bytes"}, {"sha256", "SHA-256"}};
  text += "## Inputs\n\n" + table(record["inputs"], file_columns);
  text += "## Outputs\n\n" + table(record["outputs"], file_columns);
  return text + pictures_part(pictures);
}

std::string diff_page(const Json& diff, const std::vector<std::string>& pictures,
                      const std::string& why_not) {
  std::string text = fmt::format("# What differs between two runs\n\n- A: {}\n- B: {}\n\n",
                                 shown(diff["a"]), shown(diff["b"]));
  text += why_not.empty() ? pictures_part(pictures) +
                                "Both in motion: [compare/compare.html](compare/compare.html).\n\n"
                          : fmt::format("No pictures: {}.\n\n", plain(why_not));
  for (const auto& [part, compared] : diff["parts"].items()) {
    text += fmt::format("## {}{}\n\n{} differ, {} are equal.\n\n",
                        static_cast<char>(std::toupper(part[0])), part.substr(1),
                        compared["differing"].size(), compared["equal"].dump());
    Json rows = compared["differing"];
    for (auto& row : rows) {
      if (row["change"].is_number())
        row["change"] = fmt::format("{:+.3g} %", 100.0 * row["change"].get<double>());
    }
    if (!rows.empty()) {
      text += table(
          rows, {{"name", "Name"}, {"a", "A"}, {"b", "B"}, {"unit", "Unit"}, {"change", "Change"}});
    }
  }
  return text;
}

}  // namespace viscera::engine
