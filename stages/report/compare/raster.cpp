#include "stages/report/compare/raster.hpp"

#include <png.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "pipeline/base/error.hpp"

namespace viscera {
namespace {

constexpr int samples = 2;  // across and down a pixel
constexpr float nowhere = std::numeric_limits<float>::infinity();
constexpr Colour paper = {1.0, 1.0, 1.0};

using Vec = std::array<double, 3>;
Vec cross(const Vec& a, const Vec& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
double dot(const Vec& a, const Vec& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
Vec unit(const Vec& a) {
  const double length = std::sqrt(dot(a, a));
  return length > 0.0 ? Vec{a[0] / length, a[1] / length, a[2] / length} : Vec{};
}

std::vector<Vec> vertex_normals(const Surface& surface) {
  std::vector<Vec> normals(surface.xyz.size() / 3);
  const auto at = [&](int i) {
    return Vec{surface.xyz[3 * i], surface.xyz[3 * i + 1], surface.xyz[3 * i + 2]};
  };
  for (const auto& t : surface.triangles) {
    const Vec a = at(t[0]), b = at(t[1]), c = at(t[2]);
    const Vec normal =
        cross({b[0] - a[0], b[1] - a[1], b[2] - a[2]}, {c[0] - a[0], c[1] - a[1], c[2] - a[2]});
    for (const int i : t) {
      for (int k = 0; k < 3; ++k) normals[i][k] += normal[k];
    }
  }
  for (Vec& normal : normals) normal = unit(normal);
  return normals;
}

}  // namespace

void Image::paste(const Image& other, int left, int top) {
  for (int y = 0; y < other.height && top + y < height; ++y) {
    const int count = std::min(other.width, width - left);
    std::memcpy(&rgb[3 * ((top + y) * width + left)], &other.rgb[3 * y * other.width], 3 * count);
  }
}

Image blank(int width, int height, const Colour& colour) {
  Image image{width, height, {}};
  image.rgb.resize(3 * static_cast<std::size_t>(width) * height);
  for (std::size_t i = 0; i < image.rgb.size(); ++i) {
    image.rgb[i] = static_cast<std::uint8_t>(std::lround(255.0 * colour[i % 3]));
  }
  return image;
}

void write_png(const std::string& path, const Image& image) {
  png_image header{};
  header.version = PNG_IMAGE_VERSION;
  header.width = static_cast<png_uint_32>(image.width);
  header.height = static_cast<png_uint_32>(image.height);
  header.format = PNG_FORMAT_RGB;
  if (png_image_write_to_file(&header, path.c_str(), 0, image.rgb.data(), 0, nullptr)) return;
  throw Error(ExitCode::usage, {.where = path,
                                .found = std::string("could not be written: ") + header.message,
                                .remedy = "check the free space"});
}

Canvas::Canvas(int width, int height, const Camera& camera)
    : width_(samples * width), height_(samples * height), camera_(camera) {
  camera_.view = unit(camera.view);
  right_ = unit(cross(camera_.view, {0.0, 0.0, 1.0}));
  up_ = cross(right_, camera_.view);
  scale_ = 0.5 * height_ / camera.half_height;
  depth_.assign(static_cast<std::size_t>(width_) * height_, nowhere);
  colour_.assign(depth_.size(), paper);
}

// Samples right and down, and mm away from the camera.
std::array<double, 3> Canvas::project(const float* xyz) const {
  const Vec d = {xyz[0] - camera_.centre[0], xyz[1] - camera_.centre[1],
                 xyz[2] - camera_.centre[2]};
  return {0.5 * width_ + scale_ * dot(d, right_), 0.5 * height_ - scale_ * dot(d, up_),
          dot(d, camera_.view)};
}

void Canvas::draw_ground(double height_mm) {
  const double half = 1.9 * camera_.half_height * width_ / height_;
  const auto x = static_cast<float>(camera_.centre[0]), y = static_cast<float>(camera_.centre[1]);
  const auto h = static_cast<float>(half), z = static_cast<float>(height_mm);
  const float corners[] = {x - h, y - h, z, x + h, y - h, z, x + h, y + h, z, x - h, y + h, z};
  const std::array<int, 3> triangles[] = {{0, 1, 2}, {0, 2, 3}};
  draw({corners, triangles, {0.97, 0.98, 1.0}});
}

Canvas::Layer Canvas::shaded(const Surface& surface) const {
  Layer layer{std::vector<float>(depth_.size(), nowhere), std::vector<Colour>(depth_.size())};
  const std::vector<Vec> normals = vertex_normals(surface);
  const Vec& v = camera_.view;
  const Vec lamp =
      unit({-v[0] - 0.5 * right_[0] + 0.9 * up_[0], -v[1] - 0.5 * right_[1] + 0.9 * up_[1],
            -v[2] - 0.5 * right_[2] + 0.9 * up_[2]});
  for (const auto& t : surface.triangles) {
    Vec p[3];
    for (int i = 0; i < 3; ++i) p[i] = project(&surface.xyz[3 * t[i]]);
    const double area =
        (p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[2][0] - p[0][0]) * (p[1][1] - p[0][1]);
    if (!(std::abs(area) > 1e-12)) continue;
    const auto [x0, x1] = std::minmax({p[0][0], p[1][0], p[2][0]});
    const auto [y0, y1] = std::minmax({p[0][1], p[1][1], p[2][1]});
    for (int y = std::max(0, static_cast<int>(y0)); y <= std::min(height_ - 1.0, y1); ++y) {
      for (int x = std::max(0, static_cast<int>(x0)); x <= std::min(width_ - 1.0, x1); ++x) {
        const double cx = x + 0.5, cy = y + 0.5;
        const double w1 =
            ((cx - p[0][0]) * (p[2][1] - p[0][1]) - (p[2][0] - p[0][0]) * (cy - p[0][1])) / area;
        const double w2 =
            ((p[1][0] - p[0][0]) * (cy - p[0][1]) - (cx - p[0][0]) * (p[1][1] - p[0][1])) / area;
        const double w0 = 1.0 - w1 - w2;
        if (w0 < 0.0 || w1 < 0.0 || w2 < 0.0) continue;
        const auto depth = static_cast<float>(w0 * p[0][2] + w1 * p[1][2] + w2 * p[2][2]);
        const std::size_t at = static_cast<std::size_t>(y) * width_ + x;
        if (!(depth < layer.depth[at])) continue;
        layer.depth[at] = depth;
        Vec n{};
        for (int k = 0; k < 3; ++k) {
          n[k] = w0 * normals[t[0]][k] + w1 * normals[t[1]][k] + w2 * normals[t[2]][k];
        }
        const double light = 0.42 + 0.58 * std::max(0.0, dot(unit(n), lamp));
        for (int k = 0; k < 3; ++k) {
          const auto& c = surface.colours;
          const double own =
              c.empty() ? surface.colour[k] : w0 * c[t[0]][k] + w1 * c[t[1]][k] + w2 * c[t[2]][k];
          layer.colour[at][k] = light * own;
        }
      }
    }
  }
  return layer;
}

void Canvas::draw(const Surface& surface) {
  const Layer layer = shaded(surface);
  for (std::size_t i = 0; i < depth_.size(); ++i) {
    if (!(layer.depth[i] < depth_[i])) continue;
    depth_[i] = layer.depth[i];
    colour_[i] = layer.colour[i];
  }
}

void Canvas::draw_over(const Surface& surface, double opacity, const Colour& outline) {
  const Layer layer = shaded(surface);
  const auto inside = [&](int x, int y) {
    return x >= 0 && y >= 0 && x < width_ && y < height_ &&
           layer.depth[static_cast<std::size_t>(y) * width_ + x] < nowhere;
  };
  constexpr int reach = 2;  // samples
  for (int y = 0; y < height_; ++y) {
    for (int x = 0; x < width_; ++x) {
      if (!inside(x, y)) continue;
      const std::size_t at = static_cast<std::size_t>(y) * width_ + x;
      bool edge = false;
      for (const auto& [dx, dy] : {std::pair{reach, 0}, {-reach, 0}, {0, reach}, {0, -reach}}) {
        edge = edge || !inside(x + dx, y + dy);
      }
      for (int k = 0; k < 3; ++k) {
        colour_[at][k] =
            edge ? outline[k] : (1.0 - opacity) * colour_[at][k] + opacity * layer.colour[at][k];
      }
    }
  }
}

Image Canvas::image() const {
  Image image = blank(width_ / samples, height_ / samples, paper);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      for (int k = 0; k < 3; ++k) {
        double sum = 0.0;
        for (int s = 0; s < samples * samples; ++s) {
          const int sx = samples * x + s % samples, sy = samples * y + s / samples;
          sum += colour_[static_cast<std::size_t>(sy) * width_ + sx][k];
        }
        image.rgb[3 * (y * image.width + x) + k] =
            static_cast<std::uint8_t>(std::lround(255.0 * sum / (samples * samples)));
      }
    }
  }
  return image;
}

}  // namespace viscera
