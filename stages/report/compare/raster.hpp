// Pictures of triangle surfaces without a window or a graphics driver (Debian's VTK renders only to
// an X display): parallel projection, depth buffer, diffuse light, four samples a pixel. Equal
// input gives equal bytes on every machine.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace viscera {

using Colour = std::array<double, 3>;  // 0 to 1

struct Image {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgb;  // rows from the top

  void paste(const Image& other, int left, int top);
};

Image blank(int width, int height, const Colour& colour);

// As PNG. Throws Error(usage) when the file cannot be written.
void write_png(const std::string& path, const Image& image);

struct Surface {
  std::span<const float> xyz;                     // mm, LPS, three a point
  std::span<const std::array<int, 3>> triangles;  // outward
  Colour colour{};
  std::span<const Colour> colours{};  // one a point; empty: `colour` everywhere
};

// What a picture shows: seen along `view`, superior up, `half_height` mm above and below `centre`.
struct Camera {
  std::array<double, 3> centre{}, view{};
  double half_height = 100.0;
};

class Canvas {
 public:
  Canvas(int width, int height, const Camera& camera);

  // A horizontal square of the plane z = `height` around what the camera looks at.
  void draw_ground(double height_mm);
  void draw(const Surface& surface);
  // Seen through, over what is there, with its silhouette drawn in `outline`.
  void draw_over(const Surface& surface, double opacity, const Colour& outline);

  Image image() const;

 private:
  struct Layer {
    std::vector<float> depth;
    std::vector<Colour> colour;
  };
  Layer shaded(const Surface& surface) const;
  std::array<double, 3> project(const float* xyz) const;

  int width_, height_;  // samples
  Camera camera_;
  std::array<double, 3> right_{}, up_{};
  double scale_ = 1.0;
  std::vector<float> depth_;
  std::vector<Colour> colour_;
};

}  // namespace viscera
