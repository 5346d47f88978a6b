#include "tests/measured/page.hpp"

#include <fmt/format.h>

#include <cmath>

#include "pipeline/base/atomic_file.hpp"

namespace viscera::sim {
namespace {

const char* const head =
    "# Measured bodies\n\n"
    "What the product computes of bodies that someone has measured, made by\n\n"
    "    VISCERA_MEASURED=FOLDER make measured\n\n"
    "FOLDER holds what may not be part of this project: `truth_cube_uniaxial.csv` from the "
    "repository of OpenSurgSim (Apache-2.0) and `pdms_cylinder/cylinderPDMS12724Vol.vtk` from that "
    "of fenics-inverseFEM (GPL-3.0). Bodies whose data are not there are skipped. "
    "Elements, scheme and precision of `xpbd (default)` are those that a spec gets which names "
    "nothing. No parameter was fitted to a state that is judged here: what was fitted, and to "
    "what, stands with each body. *Allowed* is the goal that was set before; what is above it is "
    "bold.\n";

std::string cell(double value) {
  return std::isnan(value) ? "–" : fmt::format("{:.3g}", value);
}

std::string section(const MeasuredBody& body) {
  std::string text = fmt::format("\n## {}\n\n{}\n", body.name, body.about);
  if (!body.skipped.empty()) return text + fmt::format("\nSkipped: {}.\n", body.skipped);
  text +=
      "\n| state | quantity | solver | error | allowed | the measurement's own | s | |\n"
      "|---|---|---|---|---|---|---|---|\n";
  for (const auto& row : body.rows) {
    const std::string error = fmt::format("{} {}", cell(row.error), row.unit);
    text += fmt::format("| {} | {} | {} | {} | {} | {} | {} | {} |\n", row.state, row.quantity,
                        row.way, row.error <= row.allowed ? error : "**" + error + "**",
                        cell(row.allowed), cell(row.uncertainty), cell(row.seconds), row.note);
  }
  for (const auto& picture : body.pictures) {
    text += fmt::format("\n![{}]({})\n\n{}\n", picture.caption, picture.file, picture.caption);
  }
  return text;
}

}  // namespace

Drawing::Drawing(Point low, Point high, double scale) : low_(low), high_(high), scale_(scale) {}

Drawing::Point Drawing::place(Point at) const {
  return {scale_ * (at[0] - low_[0]), scale_ * (high_[1] - at[1])};
}

void Drawing::dot(Point at, double radius_px, const char* colour, bool filled) {
  const auto [x, y] = place(at);
  items_ +=
      fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"{:.1f}\" fill=\"{}\" stroke=\"{}\"/>\n",
                  x, y, radius_px, filled ? colour : "none", colour);
}

void Drawing::line(const std::vector<Point>& points, const char* colour, double width_px) {
  std::string places;
  for (const auto& point : points) {
    const auto [x, y] = place(point);
    places += fmt::format("{:.1f},{:.1f} ", x, y);
  }
  items_ +=
      fmt::format("<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{}\"/>\n",
                  places, colour, width_px);
}

void Drawing::text(Point at, const std::string& words, const char* colour) {
  const auto [x, y] = place(at);
  items_ += fmt::format(
      "<text x=\"{:.1f}\" y=\"{:.1f}\" font-family=\"sans-serif\" font-size=\"13\" "
      "fill=\"{}\">{}</text>\n",
      x, y, colour, words);
}

std::string Drawing::svg() const {
  const double width = scale_ * (high_[0] - low_[0]), height = scale_ * (high_[1] - low_[1]);
  return fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0:.0f}\" height=\"{1:.0f}\" "
      "viewBox=\"0 0 {0:.0f} {1:.0f}\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
      "{2}</svg>\n",
      width, height, items_);
}

void write_page(const std::filesystem::path& folder, const std::vector<MeasuredBody>& bodies) {
  std::filesystem::create_directories(folder);
  std::string page = head,
              csv = "body,state,quantity,solver,error,allowed,uncertainty,unit,seconds\n";
  for (const auto& body : bodies) {
    page += section(body);
    for (const auto& row : body.rows) {
      csv += fmt::format("{},{},{},{},{:.6g},{:.6g},{},{},{:.3g}\n", body.name, row.state,
                         row.quantity, row.way, row.error, row.allowed, cell(row.uncertainty),
                         row.unit, row.seconds);
    }
    for (const auto& picture : body.pictures) write_atomically(folder / picture.file, picture.svg);
  }
  write_atomically(folder / "measured.csv", csv);
  write_atomically(folder / "measured.md", page);
}

}  // namespace viscera::sim
