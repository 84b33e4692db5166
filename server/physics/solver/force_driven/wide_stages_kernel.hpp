// The kernels of the two stages of a force-driven step of second order (stages.cpp), part of wide_slip_kernel.hpp.

// The jump of the lanes from l on along its direction, which without a jump is that of its acceleration.
struct Jump {
  [[gnu::always_inline]] Jump(const TileInputs& host, std::ptrdiff_t l) : forces(host, l) {
    const Register jump = load(host.velocity_jump + l);
    direction = where(where(jump != 0.0, jump, forces.acceleration) < 0.0, all(-1.0), all(1.0));
    old = direction * jump;
  }
  // The jump after dt without friction.
  [[gnu::always_inline]] Register free(double dt) const { return old + dt * direction * forces.acceleration; }

  Forces forces;
  Register direction, old;
};

// Whether the answer was found and leaves the interface solid.
[[gnu::always_inline]] inline Mask found_solid(const Lanes& s, const Search& search, Register a_stick) {
  const Register a = search.answer;
  const Register T0 = s.T_ad + s.rise * (a * s.slip(a));
  return settled(s, search, a_stick) & (T0 < s.T_melt) & is_accurate(s, T0);
}

inline StageLanes first_stage(const WideStep& in, const WideStage& stage, StageAnswer& answer) {
  const TileInputs& host = in.interface.inputs;
  const Interface interface(in.interface);
  Lanes lanes[kParts];
  Search search[kParts];
  StageLanes sets{};
  std::uint32_t active = 0;
  SHEARBUS_EACH_PART {
    const std::ptrdiff_t l = p * kWidth;
    const Jump jump(host, l);
    const Register free = jump.free(stage.dt);
    lanes[p] = interface.lanes(l, load(stage.T_ad + l), in.heat_partition * stage.B0, free,
                               stage.dt * jump.forces.mobility, 1.0, all(0.0));
    const Mask in_step = mask_of(host.active >> l), closed = load(host.pressure + l) > 0.0;
    const Mask wanted = in_step & closed & without((free < 0.0) | (jump.free(in.dt) < 0.0));
    search[p] = begin(lanes[p], free / lanes[p].b, magnitude(load(in.interface.stress_before + l)), wanted);
    sets.solved |= lanes_where(in_step & without(closed)) << l;
    sets.left |= lanes_where(wanted) << l;
    active |= lanes_where(search[p].active) << l;
  }
  const std::uint32_t ended = search_all(lanes, search, active, host.effort);

  SHEARBUS_EACH_PART {
    const std::ptrdiff_t l = p * kWidth;
    const Lanes& s = lanes[p];
    const Register a = search[p].answer, a_stick = s.c / s.b;
    const Mask found = found_solid(s, search[p], a_stick) & mask_of(ended >> l);
    const Mask sticks = found & (a == a_stick), slides = found & without(sticks);
    const Mask rests = sticks & (load(host.velocity_jump + l) == 0.0);
    sets.solved |= lanes_where(slides | rests) << l;
    sets.resting |= lanes_where(rests) << l;
    sets.left &= ~(lanes_where(found) << l);
    store(where(found, a, all(0.0)), answer.stress + l);
    store(where(slides, in.heat_partition * (a * s.slip(a)), all(0.0)), answer.flux + l);
  }
  return sets;
}
inline StageLanes second_stage(const WideStep& in, const WideStage& stage, const StageAnswer& early,
                               const StageLanes& before, WideAnswer& answer) {
  constexpr double kGain = sdirk2::kDiagonal, kKept = sdirk2::kFirstWeight;
  const TileInputs& host = in.interface.inputs;
  const Interface interface(in.interface);
  Lanes lanes[kParts];
  Search search[kParts];
  Register a_stick[kParts];
  StageLanes sets{};
  std::uint32_t active = 0;
  SHEARBUS_EACH_PART {
    const std::ptrdiff_t l = p * kWidth;
    const Jump jump(host, l);
    const Register free = jump.free(in.dt), stress = load(early.stress + l);
    lanes[p] = interface.lanes(l, load(stage.T_ad + l) - stage.B0 * (kKept / kGain) * load(early.flux + l),
                               in.heat_partition * stage.B0 / kGain, 0.5 * (jump.old + free),
                               0.5 * in.dt * jump.forces.mobility, kGain, kKept * stress);
    a_stick[p] = free / (in.dt * jump.forces.mobility);
    const Mask wanted = mask_of((before.solved & ~before.resting) >> l) & (load(host.pressure + l) > 0.0);
    search[p] = begin(lanes[p], a_stick[p], stress, wanted);
    sets.left |= lanes_where(wanted) << l;
    active |= lanes_where(search[p].active) << l;
  }
  const std::uint32_t ended = search_all(lanes, search, active, host.effort);

  SHEARBUS_EACH_PART {
    const std::ptrdiff_t l = p * kWidth;
    const Lanes& s = lanes[p];
    const Jump jump(host, l);
    const Register free = jump.free(in.dt), T_ad = load(stage.T_ad + l);
    const Register early_stress = load(early.stress + l), early_flux = load(early.flux + l);
    const Mask found = found_solid(s, search[p], a_stick[p]) & mask_of(ended >> l);
    const Mask open = mask_of(before.solved >> l) & without(load(host.pressure + l) > 0.0);
    const Mask rests = mask_of((before.solved & before.resting) >> l);

    // A sliding node: the stress equals the limit at the temperature that the heat of the step leaves.
    const Register a = search[p].answer, slip = s.slip(a);
    const Register flux = (in.heat_partition * (a * slip) - kKept * early_flux) / kGain;
    const Register T0 = T_ad + stage.B0 * where(found, flux, all(0.0));
    const Lanes::Branches limit = s.at(T0);
    const Mask rubs = limit.friction <= limit.yield;
    const Register carried = where(rubs, limit.friction, limit.yield);
    const Mask met = magnitude(s.offset + carried - a) <= kMet * a;
    const Mask slides = found & without(a == a_stick[p]) & (flux >= 0.0) & met;
    // A node at rest: the limit, without flux, still carries its stress.
    const Mask holds = rests & (carried >= kGain * early_stress);

    const Register stress = where(slides, a, where(holds, early_stress, all(0.0)));
    const Register mean = where(slides, slip, where(open, 0.5 * (jump.old + free), all(0.0)));
    const Register jump_new = free - stress * (in.dt * jump.forces.mobility);
    const Register heats = where(slides, flux, all(0.0));
    const Register yields =
        where(T0 >= kMeltingShare * s.T_melt, all(number(Regime::kMelting)), all(number(Regime::kTresca)));
    sets.solved |= lanes_where(open | slides | holds) << l;
    sets.resting |= lanes_where(holds) << l;
    sets.left &= ~(lanes_where(found) << l);
    store(jump.direction * stress, answer.stress + l);
    store(jump.direction * mean, answer.slip + l);
    store(where(holds, all(0.0), jump.direction * jump_new), answer.jump_new + l);
    store(heats, answer.flux + l);
    store(in.dt * (kKept * early_flux + kGain * heats), answer.heat + l);
    store(where(open, all(number(Regime::kOpen)),
                where(holds, all(number(Regime::kStick)), where(rubs, all(number(Regime::kCoulomb)), yields))),
          answer.regime + l);
  }
  return sets;
}
