// What measured bodies come to: measured.csv, measured.md and its pictures.
#pragma once

#include <array>
#include <filesystem>
#include <string>
#include <vector>

namespace viscera::sim {

struct Comparison {
  std::string state, quantity, way;
  double error, allowed;  // of the goal; in `unit`
  double uncertainty;     // the measurement's own, in `unit`; NaN: not known
  std::string unit, note;
  double seconds;  // wall time of the run
};

// A drawing whose lengths are mm of the body, y upwards.
class Drawing {
 public:
  using Point = std::array<double, 2>;
  // Of the rectangle between two corners, `scale` px a mm.
  Drawing(Point low, Point high, double scale);
  void dot(Point at, double radius_px, const char* colour, bool filled = true);
  void line(const std::vector<Point>& points, const char* colour, double width_px = 1.5);
  void text(Point at, const std::string& words, const char* colour = "#333");
  std::string svg() const;

 private:
  Point place(Point at) const;
  Point low_, high_;
  double scale_;
  std::string items_;
};

struct MeasuredBody {
  std::string name, about;  // about: Markdown, what was measured and how it is modelled
  std::vector<Comparison> rows;
  struct Picture {
    std::string file, caption, svg;
  };
  std::vector<Picture> pictures;
  std::string skipped;  // why nothing was compared; empty: it was
};

// Each throws std::runtime_error for files that are not what they should be.
MeasuredBody silicone_beam();
MeasuredBody truth_cube(const std::filesystem::path& data);
MeasuredBody pdms_cylinder(const std::filesystem::path& data);

// Writes the page and its pictures into a folder.
void write_page(const std::filesystem::path& folder, const std::vector<MeasuredBody>& bodies);

}  // namespace viscera::sim
