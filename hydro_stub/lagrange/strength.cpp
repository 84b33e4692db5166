#include "hydro_stub/lagrange/strength.hpp"

#include <algorithm>
#include <cmath>

#include "hydro_stub/lagrange/independent.hpp"
#include "server/physics/material/compression.hpp"

namespace shearbus::lagrange {
namespace {

// Rotates the old deviators with the metal, and adds the elastic growth of the step. Stores the equivalent stresses.
void find_trial(double shear_modulus, double dt, Strip& strip, double (&trial)[Strip::kMostZones]) {
  const double stretch = 2.0 * shear_modulus * dt;
  for (int i = 0; i < strip.zones; ++i) {
    const double xx = strip.xx[i], yy = strip.yy[i], xy = strip.xy[i];
    const double t = 0.5 * strip.spin[i] * dt;  // tangent of half the angle of rotation
    const double scale = 1.0 / (1.0 + t * t);
    const double cosine = (1.0 - t * t) * scale;
    const double sine = 2.0 * t * scale;
    const double shear = 2.0 * sine * cosine * xy;
    const double cc = cosine * cosine;
    const double ss = sine * sine;
    const Deviator s = {(cc * xx + ss * yy - shear) + stretch * strip.strain_rate_xx[i],
                        (ss * xx + cc * yy + shear) + stretch * strip.strain_rate_yy[i],
                        (sine * cosine * (xx - yy) + (cc - ss) * xy) + stretch * strip.strain_rate_xy[i]};
    strip.xx[i] = s.xx;
    strip.yy[i] = s.yy;
    strip.xy[i] = s.xy;
    trial[i] = equivalent_stress(s);
  }
}

// Stores the melting temperatures and the pressure terms of the zones.
inline void find_compression(const physics::Material& metal, const Strip& strip, double (&melting)[Strip::kMostZones],
                             double (&coefficient)[Strip::kMostZones]) {
  const physics::Material m = metal;
  const bool simon = m.melting_curve == physics::MeltingCurve::kSimon;
  const bool lindemann = m.melting_curve == physics::MeltingCurve::kLindemann;
  for (int i = 0; i < strip.zones; ++i) melting[i] = m.melting_temperature;
  for (int i = 0; i < strip.zones; ++i) coefficient[i] = m.pressure_coefficient;
  if (simon) {
    for (int i = 0; i < strip.zones; ++i) melting[i] = physics::compression::simon_temperature(m, strip.pressure[i]);
  }
  if (lindemann) {
    for (int i = 0; i < strip.zones; ++i) {
      melting[i] = physics::compression::lindemann_temperature(m, physics::compression::eta_at(m, strip.pressure[i]));
    }
  }
  if (m.pressure_term != physics::PressureTerm::kCompressed) return;
  for (int i = 0; i < strip.zones; ++i) {
    coefficient[i] =
        physics::compression::compressed_pressure_coefficient(m, physics::compression::eta_at(m, strip.pressure[i]));
  }
}

// Stores the softening g(P, T) of the zones, their flow stress at rest, and its slope in a step that yields no more.
template <class Law>
void find_strength(const physics::Material& metal, double dt, const Strip& strip, double (&g)[Strip::kMostZones],
                   double (&strength)[Strip::kMostZones], double (&slope)[Strip::kMostZones]) {
  const physics::Material m = metal;  // a copy, which no store to the arrays can change
  if (m.varies_with_compression()) {
    double melting[Strip::kMostZones], coefficient[Strip::kMostZones];
    find_compression(metal, strip, melting, coefficient);
    for (int i = 0; i < strip.zones; ++i) {
      physics::Material now = m;
      now.melting_temperature = melting[i];
      now.pressure_coefficient = coefficient[i];
      g[i] = Law::softening(now, strip.pressure[i], strip.temperature[i]).g;
    }
  } else {
    for (int i = 0; i < strip.zones; ++i) g[i] = Law::softening(m, strip.pressure[i], strip.temperature[i]).g;
  }
  constexpr double kNone = 0.0;  // added to the strain in both lines, so that their common part is computed once
  for (int i = 0; i < strip.zones; ++i) {
    const double ep = strip.plastic_strain[i], P = strip.pressure[i], T = strip.temperature[i];
    strength[i] = g[i] * Law::hardened(m, ep + kNone, kNone, P, T);
    slope[i] = g[i] * Law::hardening_slope(m, ep, kNone, dt, P, T);
  }
}

// Zones that yield: for each the increment x of the plastic strain that solves Y(ep + x, x/dt) + 3 G x = trial, with
// the flow stress Y at plastic strain and strain rate, the shear modulus G, and the equivalent stress `trial` of the
// trial deviator. The left side rises strictly. Newton's iterates are kept between 0 and the increment of perfect
// plasticity. Under concave hardening they rise from x = 0 to the root and do not pass the root.
template <class Law>
class Yielding {
 public:
  Yielding(const physics::Material& metal, double dt) : metal_(metal), dt_(dt), stiffness_(3.0 * metal.shear_modulus) {}

  // Adds zone i of the strip, whose trial stress exceeds its strength. The slope is that of the strength at x = 0.
  void add(const Strip& strip, int i, double trial, double softening, double strength, double slope) {
    zone_[count_] = i;
    trial_[count_] = trial;
    g_[count_] = softening;
    ep_[count_] = strip.plastic_strain[i];
    pressure_[count_] = strip.pressure[i];
    temperature_[count_] = strip.temperature[i];
    strength_[count_] = strength;
    slope_[count_] = slope;
    left_[count_] = x_[count_] = 0.0;
    right_[count_] = (trial - strength) / stiffness_;
    ++count_;
  }
  // Solves for the increments of all zones and stores them in the strip.
  void solve(Strip& strip) {
    if (!Law::hardens(metal_)) {
      for (int j = 0; j < count_; ++j) strip.increment[zone_[j]] = right_[j];
      return;
    }
    constexpr int kMostIterations = 200;
    for (int i = 0; i < kMostIterations && count_ > 0; ++i) {
      if (i > 0) evaluate();
      improve();
      keep_unsolved(strip, i + 1 == kMostIterations);
    }
  }

 private:
  static constexpr double kConverged = 1e-7;  // the error after a step of Newton's method is of the order of its square
  static constexpr double kRounding = 1e-13;  // an error of rounding, which no step lowers

  // Finds the strength and its slope at x; add() has those at x = 0.
  void evaluate() {
    const physics::Material m = metal_;  // copies, which no store to the arrays can change
    const double dt = dt_;
    for (int j = 0; j < count_; ++j) {
      const double x = x_[j];
      strength_[j] = g_[j] * Law::hardened(m, ep_[j] + x, x / dt, pressure_[j], temperature_[j]);
      slope_[j] = g_[j] * Law::hardening_slope(m, ep_[j], x, dt, pressure_[j], temperature_[j]);
    }
  }
  void improve() {
    const double stiffness = stiffness_;
    for (int j = 0; j < count_; ++j) {
      const double x = x_[j];
      const double missing = trial_[j] - stiffness * x - strength_[j];
      double left = left_[j], right = right_[j];
      left = missing > 0.0 ? x : left;
      right = missing > 0.0 ? right : x;
      const double next = x + missing / (stiffness + slope_[j]);
      const double middle = 0.5 * (left + right);
      const double error = std::abs(missing) / trial_[j];
      const bool inside = (next >= left) & (next <= right);
      left_[j] = left;
      right_[j] = right;
      x_[j] = inside ? next : middle;
      error_[j] = (inside | (error <= kRounding)) ? error : 1.0;
    }
  }
  void keep_unsolved(Strip& strip, bool last) {
    int kept = 0;
    for (int j = 0; j < count_; ++j) {
      strip.increment[zone_[j]] = x_[j];
      if (error_[j] <= kConverged || last) continue;
      zone_[kept] = zone_[j];
      for (double(*values)[Strip::kMostZones] : {&trial_, &g_, &ep_, &pressure_, &temperature_, &left_, &right_, &x_}) {
        (*values)[kept] = (*values)[j];
      }
      ++kept;
    }
    count_ = kept;
  }

  const physics::Material& metal_;
  double dt_, stiffness_;
  int count_ = 0;
  int zone_[Strip::kMostZones];
  double trial_[Strip::kMostZones], g_[Strip::kMostZones], ep_[Strip::kMostZones], pressure_[Strip::kMostZones],
      temperature_[Strip::kMostZones], left_[Strip::kMostZones], right_[Strip::kMostZones], x_[Strip::kMostZones],
      error_[Strip::kMostZones], strength_[Strip::kMostZones], slope_[Strip::kMostZones];
};

template <class Law>
SHEARBUS_WIDE void advance_by_law(const physics::Material& metal, double dt, Strip& strip) {
  double trial[Strip::kMostZones], g[Strip::kMostZones], strength[Strip::kMostZones], slope[Strip::kMostZones];
  find_trial(metal.shear_modulus, dt, strip, trial);
  find_strength<Law>(metal, dt, strip, g, strength, slope);
  Yielding<Law> yielding(metal, dt);
  for (int i = 0; i < strip.zones; ++i) {
    strip.increment[i] = 0.0;
    if (trial[i] > strength[i]) yielding.add(strip, i, trial[i], g[i], strength[i], slope[i]);
  }
  yielding.solve(strip);
  for (int i = 0; i < strip.zones; ++i) {
    const double lost = 3.0 * metal.shear_modulus * strip.increment[i];
    const double rest = 1.0 - lost / trial[i];
    const double keep = lost > 0.0 ? (rest > 0.0 ? rest : 0.0) : 1.0;
    strip.xx[i] *= keep;
    strip.yy[i] *= keep;
    strip.xy[i] *= keep;
  }
}

SHEARBUS_WIDE void load_wide(const StrengthState& from, const Run& run, Strip& strip) {
  const StrengthState s = from;
  const int first = run.first;
  const double* d_xx = s.gradient.xx.data() + first;
  const double* d_yy = s.gradient.yy.data() + first;
  const double* d_tt = s.gradient.tt.data() + first;
  const double* d_xy = s.gradient.xy.data() + first;
  const double* d_yx = s.gradient.yx.data() + first;
  SHEARBUS_INDEPENDENT
  for (int i = 0; i < run.count; ++i) {
    const double mean = (d_xx[i] + d_yy[i] + d_tt[i]) / 3.0;
    strip.strain_rate_xx[i] = d_xx[i] - mean;
    strip.strain_rate_yy[i] = d_yy[i] - mean;
    strip.strain_rate_xy[i] = 0.5 * (d_xy[i] + d_yx[i]);
    strip.spin[i] = 0.5 * (d_yx[i] - d_xy[i]);
  }
  const auto copy = [&](const double* values, double(&to)[Strip::kMostZones]) {
    std::copy_n(values + first, run.count, to);
  };
  copy(s.xx, strip.xx);
  copy(s.yy, strip.yy);
  copy(s.xy, strip.xy);
  copy(s.plastic_strain, strip.plastic_strain);
  copy(s.pressure, strip.pressure);
  copy(s.temperature, strip.temperature);
  strip.zones = run.count;
}

}  // namespace

void load(const StrengthState& state, const Run& run, Strip& strip) {
  load_wide(state, run, strip);
}

void advance_deviators(const physics::Material& metal, double dt, Strip& strip) {
  physics::FlowLaws::with(metal.flow_law,
                          [&](auto law) { advance_by_law<typename decltype(law)::type>(metal, dt, strip); });
}

}  // namespace shearbus::lagrange
