// A flow law for tests, Bingham's viscous metal. Its viscosity and its yield stress soften differently, so that rate
// and temperature are coupled:
//   Y(dep/dt, T) = (A + eta (1 - T/T_melt) dep/dt) (1 - T/T_melt), with yield stress A and viscosity eta

class Bingham {
 public:
  static constexpr std::string_view kName = "bingham", kEquation = "Bingham 1922", kAdds = "viscosity", kWhen = "tests";
  // The constants of the law: the yield stress A [Pa], and the viscosity eta [Pa s] in the place of the hardening
  // modulus.
  static constexpr std::array kConstants = {&Material::yield_strength, &Material::hardening_modulus};
  static constexpr bool kDependsOnRate = true;
  static constexpr bool kSeparable = false;
  static constexpr bool kFirstOrderInTime = true;
  static constexpr bool kVanishesAtMelting = true;
  static constexpr bool kHasPressureTerm = false;
  static constexpr bool kHasCeiling = false;
  static constexpr bool kHasWaveReturn = false;

  static LawFault fault_of(const Material&) { return {}; }
  static Softening softening(const Material& m, Register /*pressure*/, Register T) {
    const Mask solid = T < m.melting_temperature;
    return {only(solid, 1.0 - T / m.melting_temperature), only(solid, all(-1.0 / m.melting_temperature))};
  }
  static Register steepest_softening(const Material& m, Register, Register /*coldest*/, Register /*hottest*/) {
    return all(1.0 / m.melting_temperature);
  }
  static Register hardened(const Material& m, Register /*ep*/, Register rate, Register pressure, Register T) {
    return m.yield_strength + m.hardening_modulus * softening(m, pressure, T).g * rate;
  }
  static Register hardening_slope(const Material& m, Register, Register /*dep*/, double dt, Register P, Register T) {
    return m.hardening_modulus * softening(m, P, T).g / dt;
  }
  static double ceiling(const Material&) { return std::numeric_limits<double>::infinity(); }
  static bool hardens(const Material&) { return true; }

  Bingham(const Material& m, double dt, const VertexLoad& load)
      : load_(load), A_(m.yield_strength), per_strain_(m.hardening_modulus / dt) {}

  // The flow is explicit, so that the search has no root to keep.
  VertexFlow flow(const LoadedVertex& at) const {
    const Register stress = kSqrt3 * load_.stress;
    const Mask solid = at.T < load_.T_melt;
    const Register g = where(solid, 1.0 - at.T / load_.T_melt, all(1.0));
    const Mask flows = at.wanted & (stress > only(solid, A_ * g));
    // relative decrease of the softening g = 1 - T/T_melt per increase of ln(stress)
    const Register lost = at.rise / (load_.T_melt * g);
    const Register dep = where(solid, (stress / g - A_) / (per_strain_ * g), all(1e50));
    const Register slope = where(solid, stress * (1.0 + lost) / (per_strain_ * g * g) + dep * lost, all(1e50));
    return {only(flows, dep), only(flows, slope), all(0.0), all(0.0)};
  }

 private:
  VertexLoad load_;
  double A_, per_strain_;
};
