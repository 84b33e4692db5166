// A vector in the plane: (x, y) in plane symmetry; in axisymmetry x is the radius and y the coordinate along the axis.
#pragma once

#include <cmath>

namespace shearbus::lagrange {

struct Vec2 {
  double x = 0.0;
  double y = 0.0;

  Vec2& operator+=(Vec2 o) {
    x += o.x;
    y += o.y;
    return *this;
  }
  Vec2& operator-=(Vec2 o) {
    x -= o.x;
    y -= o.y;
    return *this;
  }
};

inline Vec2 operator+(Vec2 a, Vec2 b) {
  return {a.x + b.x, a.y + b.y};
}
inline Vec2 operator-(Vec2 a, Vec2 b) {
  return {a.x - b.x, a.y - b.y};
}
inline Vec2 operator*(double s, Vec2 a) {
  return {s * a.x, s * a.y};
}
inline double dot(Vec2 a, Vec2 b) {
  return a.x * b.x + a.y * b.y;
}
inline double cross(Vec2 a, Vec2 b) {
  return a.x * b.y - a.y * b.x;
}
inline double norm(Vec2 a) {
  return std::sqrt(dot(a, a));
}
// left_of() rotates a vector by 90 degrees counter-clockwise, right_of() clockwise.
inline Vec2 left_of(Vec2 a) {
  return {-a.y, a.x};
}
inline Vec2 right_of(Vec2 a) {
  return {a.y, -a.x};
}

}  // namespace shearbus::lagrange
