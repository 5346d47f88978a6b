// The one quality that the improver works with, of one tet or of several side by side. Straight
// arithmetic without branches, so that the compiler does four or eight tets at a time; every
// instruction set gives the same bits.
#include <algorithm>
#include <numbers>

#include "stages/tetmesh/improve/improve_stars.hpp"

// Compiled for several instruction sets, chosen when the program starts; only GCC does so.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define VISCERA_CLONES __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define VISCERA_CLONES
#endif

namespace viscera {
namespace {

struct V {
  double x, y, z;
};
inline V operator-(const V& a, const V& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
inline double operator*(const V& a, const V& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
inline V crossed(const V& a, const V& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline double least(double a, double b) {
  return b < a ? b : a;
}
inline double most(double a, double b) {
  return a < b ? b : a;
}

// To 2e-8 (Abramowitz and Stegun 4.4.46): a third of the library's time, which the improver feels.
inline double arc_cosine(double x) {
  const double y = least(std::abs(x), 1.0);
  double sum = -0.0012624911;
  sum = sum * y + 0.0066700901;
  sum = sum * y + -0.0170881256;
  sum = sum * y + 0.0308918810;
  sum = sum * y + -0.0501743046;
  sum = sum * y + 0.0889789874;
  sum = sum * y + -0.2145988016;
  sum = sum * y + 1.5707963050;
  const double angle = std::sqrt(1.0 - y) * sum;
  return x < 0.0 ? std::numbers::pi - angle : angle;
}

const double best_min_angle = arc_cosine(1.0 / 3.0);  // of a regular tet, 70.5 deg
constexpr double best_altitude = 0.816496580927726;   // sqrt(2/3), over its edge
// How much more room altitudes get than angles: at equal quality an angle is the first to object,
// except in needles.
constexpr double altitude_weight = 1.5;
// The same for the scaled Jacobian: at 0.07, which needles of passable altitude have, it objects as
// loudly as an angle of 19 deg.
constexpr double jacobian_weight = 3.8;

inline double quality(const V& a, const V& b, const V& c, const V& d, double size) {
  const V u = b - a, v = c - a, w = d - a, bc = c - b, bd = d - b, cd = d - c;
  const V n0 = crossed(bc, bd), n1 = crossed(w, v), n2 = crossed(u, w), n3 = crossed(v, u);
  const double six_volumes = -(w * n3);
  const double i0 = 1.0 / std::sqrt(n0 * n0), i1 = 1.0 / std::sqrt(n1 * n1),
               i2 = 1.0 / std::sqrt(n2 * n2), i3 = 1.0 / std::sqrt(n3 * n3);
  // Cosines of the dihedral angles.
  const double c01 = -(n0 * n1) * i0 * i1, c02 = -(n0 * n2) * i0 * i2, c03 = -(n0 * n3) * i0 * i3,
               c12 = -(n1 * n2) * i1 * i2, c13 = -(n1 * n3) * i1 * i3, c23 = -(n2 * n3) * i2 * i3;
  const double low = least(least(least(c01, c02), least(c03, c12)), least(c13, c23));
  const double high = most(most(most(c01, c02), most(c03, c12)), most(c13, c23));
  const double altitude = six_volumes * least(least(i0, i1), least(i2, i3));
  const double uu = u * u, vv = v * v, ww = w * w, bb = bc * bc, dd = bd * bd, cc = cd * cd;
  const double longest = std::sqrt(most(most(most(uu, vv), most(ww, bb)), most(dd, cc)));
  const double widest =
      most(most(uu * vv * ww, uu * bb * dd), most(vv * bb * cc, ww * dd * cc));  // at a corner
  const double jacobian = jacobian_weight * std::numbers::sqrt2 * six_volumes / std::sqrt(widest);
  const double angle = arc_cosine(high) / best_min_angle;
  const double wide = (std::numbers::pi - arc_cosine(low)) / (std::numbers::pi - best_min_angle);
  const double high_enough = altitude_weight * altitude / (best_altitude * most(longest, size));
  const double good = least(least(least(angle, wide), least(jacobian, high_enough)), 1.0);
  return six_volumes > 0.0 ? good : least(six_volumes / (size * size * size), 0.0);
}

}  // namespace

double tet_quality(const Vec& a, const Vec& b, const Vec& c, const Vec& d, double size) {
  return quality({a[0], a[1], a[2]}, {b[0], b[1], b[2]}, {c[0], c[1], c[2]}, {d[0], d[1], d[2]},
                 size);
}

VISCERA_CLONES void judge(TetLanes& lanes, int filled) {
  constexpr int abreast = 8;
  auto& p = lanes.corner;
  const int end = (filled + abreast - 1) / abreast * abreast;
  for (int i = filled; i < end; ++i) {  // idle lanes do as the first one does
    for (auto& corner : p)
      for (auto& axis : corner) axis[i] = axis[0];
    lanes.size[i] = lanes.size[0];
  }
  for (int i = 0; i < end; ++i)
    lanes.quality[i] = quality(
        {p[0][0][i], p[0][1][i], p[0][2][i]}, {p[1][0][i], p[1][1][i], p[1][2][i]},
        {p[2][0][i], p[2][1][i], p[2][2][i]}, {p[3][0][i], p[3][1][i], p[3][2][i]}, lanes.size[i]);
}

}  // namespace viscera
