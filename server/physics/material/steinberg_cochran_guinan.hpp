// Steinberg, Cochran, Guinan, J. Appl. Phys. 51 (1980) 1498, rate-independent, with the melting factor of Ball et al.:
//
//   H(ep)   = min(Y_max, Y0 (1 + beta ep)^n)                                        DLP (14), (40)
//   g(P, T) = (1 + gP P - hT (T - 300)) exp(-0.001 T / (T_melt - T))                DLP (15), (41)
//
// g is 0 where the bracket is not positive and at T_melt and above. The flow is explicit, DLP (48):
// dep = (sqrt(3) a / (Y0 g))^(1/n) / beta - (1/beta + ep). It leaves out Y_max: solvers cap the stress.

class SteinbergCochranGuinan {
 public:
  static constexpr std::string_view kName = "steinberg_cochran_guinan";
  static constexpr std::string_view kEquation = "DLP (14), (15)";
  static constexpr std::string_view kAdds = "hardening with strain, gain with pressure, softening with temperature";
  static constexpr std::string_view kWhen = "the default: metals at high rates, where the rate no longer matters";
  static constexpr std::array kConstants = {&Material::yield_strength,        &Material::yield_strength_max,
                                            &Material::hardening_coefficient, &Material::hardening_exponent,
                                            &Material::pressure_coefficient,  &Material::temperature_coefficient};

  static constexpr bool kDependsOnRate = false;
  static constexpr bool kSeparable = true;
  static constexpr bool kFirstOrderInTime = false;
  static constexpr bool kVanishesAtMelting = true;
  static constexpr bool kHasPressureTerm = true;
  static constexpr bool kHasCeiling = true;
  static constexpr bool kHasWaveReturn = true;

  static constexpr double kReference = 300.0;      // reference temperature of the term hT (T - 300)  [K]
  static constexpr double kMeltingFactor = 0.001;  // the factor in exp(-0.001 T / (T_melt - T))

  static LawFault fault_of(const Material&) { return {}; }

  // 1 + gP P + 300 hT, from which the bracket of g takes hT T.
  static double bracket_at(const Material& m, double pressure) {
    return 1.0 + m.pressure_coefficient * pressure + m.temperature_coefficient * kReference;
  }

  // Whether g is above 0. Costs less than g.
  static Mask carries_stress(const Material& m, Register pressure, Register T) {
    const Register to_melting = m.melting_temperature - T;
    return (bracket_of(m, pressure, T) > 0.0) & (kMeltingFactor * T < kExponentialRange * to_melting);
  }
  static Softening softening(const Material& m, Register pressure, Register T) {
    const Mask solid = carries_stress(m, pressure, T);
    if (!anywhere(solid)) return {};
    const Register bracket = bracket_of(m, pressure, T);
    const Register x = where(solid, m.melting_temperature - T, all(1.0));
    const Register melting = exp_of(-kMeltingFactor * T / x);
    const Register melting_rate = kMeltingFactor * m.melting_temperature / (x * x);
    return {only(solid, bracket * melting),
            only(solid, -melting * (m.temperature_coefficient + bracket * melting_rate))};
  }

  // A lower bound of g without an exponential, by exp(-x) >= 1 - x, for T > 0.
  static Register least_softening(const Material& m, Register pressure, Register T) {
    const Register to_melting = m.melting_temperature - T;
    return only(to_melting > 0.0, bracket_of(m, pressure, T) * (1.0 - kMeltingFactor * T / to_melting));
  }

  // With x = T_melt - T and c = 0.001 T_melt the steep part of dg/dT goes as exp(-c/x)/x^2, largest at x = c/2.
  static Register steepest_softening(const Material& m, Register pressure, Register coldest, Register hottest) {
    const double c = kMeltingFactor * m.melting_temperature;
    const Register nearest = larger(m.melting_temperature - hottest, all(0.0));
    const Register farthest = m.melting_temperature - coldest;
    const Register bracket = bracket_of(m, pressure, coldest);
    const Mask solid = (farthest > 0.0) & (bracket > 0.0);
    const Register x = where(solid, smaller(larger(nearest, all(0.5 * c)), farthest), all(1.0));
    const Register melting = exp_of(kMeltingFactor - c / x);  // melting factor exp(-0.001 T / x) at T = T_melt - x
    return only(solid, m.temperature_coefficient + bracket * melting * c / (x * x));
  }

  static Register hardened(const Material& m, Register ep, Register /*rate*/, Register /*pressure*/, Register /*T*/) {
    const Register hardening = power_of(1.0 + m.hardening_coefficient * ep, all(m.hardening_exponent));
    return smaller(m.yield_strength * hardening, all(m.yield_strength_max));
  }
  static Register hardening_slope(const Material& m, Register ep, Register dep, double /*dt*/, Register pressure,
                                  Register T) {
    const Register strength = hardened(m, ep + dep, all(0.0), pressure, T);
    const Register stretched = 1.0 + m.hardening_coefficient * (ep + dep);
    return only(strength < m.yield_strength_max,
                strength * (m.hardening_exponent * m.hardening_coefficient / stretched));
  }
  static double ceiling(const Material& m) {
    return hardens(m) ? m.yield_strength_max : std::min(m.yield_strength, m.yield_strength_max);
  }
  static bool hardens(const Material& m) { return m.hardening_coefficient > 0.0; }

  [[gnu::always_inline]] SteinbergCochranGuinan(const Material& m, double /*dt*/, const VertexLoad& load)
      : bracket_(load.pressed + m.temperature_coefficient * kReference),
        T_melt_(load.T_melt),
        inverse_n_(1.0 / m.hardening_exponent),
        melting_(kLog2E * kMeltingFactor / m.hardening_exponent),
        hT_(m.temperature_coefficient),
        inverse_beta_(1.0 / m.hardening_coefficient) {
    const Register ratio = (kSqrt3 / m.yield_strength) * load.stress;
    const Mask loads = ratio > kLeastStress;
    const Register log_ratio = inverse_n_ * log_of(where(loads, ratio, all(1.0)));
    log_load_ = where(loads, kLog2E * (log_ratio + log_of(all(inverse_beta_))), all(kNoLoad));
  }

  static double exponent(const Material& m) { return 1.0 / m.hardening_exponent; }
  static double cold_without_strain(const Material& m) { return 1.0 / m.hardening_coefficient; }  // cold is this + ep

  // hot is (sqrt(3) a / (Y0 g))^(1/n) / beta at T; its logarithms are binary. At T + w rise its natural logarithm is a series in w: the ratio of consecutive
  // powers is f for its term -log(bracket) / n, and v for its term 0.001 T / (T_melt - T) / n. A molten vertex is as
  // hot as kMostLogHot permits.
  [[gnu::always_inline]] Expansion expand(Register T, Register rise) const {
    const Register x = larger(T_melt_ - T, all(kLeastToMelting)), b = larger(bracket_ - hT_ * T, all(kLeastBracket));
    const SplitLogarithm log_b(b);
    // One division yields 1 / x, 1 / b and the division of the logarithm.
    const Register divisor = 2.0 + log_b.f;
    const Register xb = x * b;
    const Register inverse = 1.0 / (xb * divisor);
    const Register inverse_xb = divisor * inverse;
    const Register inverse_x = b * inverse_xb;
    const Register log_hot =
        (log_load_ + melting_ * T * inverse_x) - (kLog2E * inverse_n_) * log_b.value(log_b.f * (xb * inverse));
    const Register hot = exp2_of(log_hot, kMostLogHot);
    const Register f = hT_ * rise * x * inverse_xb, v = rise * inverse_x;
    const Register f1 = inverse_n_ * f, v1 = (kLn2 * melting_) * T_melt_ * inverse_x * v;
    const Register f2 = f1 * f, v2 = v1 * v;
    const Register s1 = f1 + v1, s2 = 0.5 * f2 + v2, s3 = (1.0 / 3.0) * (f2 * f) + v2 * v;
    const Register square = s1 * s1;
    return {hot, s1, 0.5 * square + s2, s1 * ((1.0 / 6.0) * square + s2) + s3, s1 + v};
  }

 private:
  static constexpr double kLeastStress = 0x1p-1022;  // smallest stress that is a load, over the yield strength
  static constexpr double kNoLoad = -1e305;          // logarithm of a load that lets no vertex flow
  static constexpr double kMostLogHot = 432.0;       // largest log2(hot); no host has a strain of that size
  static constexpr double kLeastToMelting = 1e-10;   // smallest T_melt - T  [K]
  static constexpr double kLeastBracket = 1e-60;

  static Register bracket_of(const Material& m, Register pressure, Register T) {
    return 1.0 + m.pressure_coefficient * pressure - m.temperature_coefficient * (T - kReference);
  }

  Register bracket_, T_melt_, log_load_;
  double inverse_n_, melting_, hT_, inverse_beta_;
};
