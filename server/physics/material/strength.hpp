// The flow stress of a material at a point of given strain, rate, pressure and temperature, whatever its law
// (server/physics/MODEL.md, "Flow stress").
#pragma once

#include "server/physics/material/flow_laws.hpp"
#include "server/physics/material/material.hpp"

namespace shearbus::physics {

inline constexpr double kMeltingShare = 0.99;  // share of T_melt above which an interface that yields is called melting

// The compression eta = rho / rho0 on the principal Hugoniot (first shock from rest) at a pressure; 1 in tension. A
// release or a second shock to the same pressure ends at another eta; for weak shocks the difference is of third order
// in 1 - 1/eta.
double compression_at(const Material& m, double pressure);

// The material at a pressure: its melting_curve and pressure_term are worked into the constants T_melt and gP.
//   T_melt(P) = T_melt exp(2 a (1 - 1/eta)) eta^(2 (gamma0 - a - 1/3))      (Lindemann's law, as Steinberg gives it)
//   T_melt(P) = T0 (1 + P/a)^(1/c)                                          (Simon, Glatzel 1929), T0 in tension
//   gP(P)     = gP / eta^(1/3)                                              (Steinberg, Cochran, Guinan 1980)
Material at_pressure(const Material& m, double pressure);

// The softening g(P, T) by the material's law, and its derivative dg/dT.
inline Softening softening(const Material& m, double pressure, double temperature) {
  if (m.varies_with_compression()) return softening(at_pressure(m, pressure), pressure, temperature);
  return FlowLaws::with(m.flow_law, [&](auto law) { return decltype(law)::type::softening(m, pressure, temperature); });
}

// A lower bound of the softening g(P, T) that costs less than g, if the law has one; else 0, or less. `m` is the material
// at the pressure.
inline double least_softening(const Material& m, double pressure, double temperature) {
  return FlowLaws::with(m.flow_law, [&](auto law) {
    using Law = typename decltype(law)::type;
    if constexpr (requires { Law::least_softening(m, pressure, temperature); })
      return Law::least_softening(m, pressure, temperature);
    else
      return 0.0;
  });
}

// Whether the softening g(P, T) is above 0; `m` is the material at the pressure.
inline bool carries_stress(const Material& m, double pressure, double temperature) {
  return FlowLaws::with(m.flow_law, [&](auto law) {
    using Law = typename decltype(law)::type;
    if constexpr (requires { Law::carries_stress(m, pressure, temperature); }) {
      return Law::carries_stress(m, pressure, temperature);
    } else {
      return Law::softening(m, pressure, temperature).g > 0.0;
    }
  });
}

// Whether the melting factor exp(-0.001 T / (T_melt - T)) is not so small that a stress may be many powers of ten below
// any guess of it.
inline bool is_far_from_melting(const Material& m, double T) {
  constexpr double kMostExponent = 10.0;
  return kMeltingFactor * T <= kMostExponent * (m.melting_temperature - T);
}

// Calls f(LawType<Law>{}, m) with the material's law. For a law that is not separable m is the material at the
// pressure.
template <class F>
double with_law_at(const Material& m, double pressure, F&& f) {
  return FlowLaws::with(m.flow_law, [&](auto law) {
    using Law = typename decltype(law)::type;
    if (!Law::kSeparable && m.varies_with_compression()) return f(law, at_pressure(m, pressure));
    return f(law, m);
  });
}

// H(ep, dep/dt, P, T): the strength before softening   [Pa]
inline double hardened_strength(const Material& m, double plastic_strain, double rate, double pressure, double T) {
  return with_law_at(m, pressure, [&](auto law, const Material& now) {
    return decltype(law)::type::hardened(now, plastic_strain, rate, pressure, T);
  });
}

// The hardening slope dH/d(dep) where a step of dt adds the plastic strain `increment`   [Pa]
inline double hardening_slope(const Material& m, double plastic_strain, double increment, double dt, double pressure,
                              double T) {
  return with_law_at(m, pressure, [&](auto law, const Material& now) {
    return decltype(law)::type::hardening_slope(now, plastic_strain, increment, dt, pressure, T);
  });
}

// The flow stress Y(ep, dep/dt, P, T)   [Pa]
inline double flow_stress(const Material& m, double plastic_strain, double pressure, double temperature,
                          double rate = 0.0) {
  return hardened_strength(m, plastic_strain, rate, pressure, temperature) * softening(m, pressure, temperature).g;
}

// The strength H of the metal at strain 0, strain rate 0, pressure 0 and room temperature   [Pa]
inline double fresh_strength(const Material& m) {
  constexpr double kRoomTemperature = 300.0;
  return hardened_strength(m, 0.0, 0.0, 0.0, kRoomTemperature);
}

// The upper limit of the strength H; infinity for a law without such a limit   [Pa]
inline double strength_ceiling(const Material& m) {
  return FlowLaws::with(m.flow_law, [&](auto law) { return decltype(law)::type::ceiling(m); });
}

// Whether strain or its rate makes the material stronger.
inline bool hardens(const Material& m) {
  return FlowLaws::with(m.flow_law, [&](auto law) { return decltype(law)::type::hardens(m); });
}

// The share of the friction heat that enters `soft` if both bodies are half-spaces, DLP (18-19):
// beta_T = k sqrt(alpha_h) / (k sqrt(alpha_h) + k_h sqrt(alpha)), where k_h and alpha_h are those of `hard`.
double heat_partition(const Material& soft, const Material& hard);

}  // namespace shearbus::physics
