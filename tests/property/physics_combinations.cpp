// Every pair of options, and every law with every option: each pair is either refused with a reason, or steps through
// random histories, checked by all invariants and against the scalar reference solver. The pairs are made from the rows
// of server/physics/solver/parts_table.hpp and from the lists of laws: a new row or law is tested without an edit here.
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <optional>
#include <string>
#include <vector>

#include "server/physics/solver/parts.hpp"
#include "tests/support/combinations.hpp"
#include "tests/support/random_history.hpp"
#include "tests/support/twin.hpp"

namespace shearbus::testing {
namespace {

void require_refusal(const ModelOptions& options) {
  const std::vector<Refusal> found = refusals(options);
  require(!found.empty(), "nothing is refused");
  for (const Refusal& refusal : found) {
    require(!refusal.key.empty() && refusal.text.find(refusal.key) != std::string::npos,
            "a refusal without its key: {}", refusal.text);
    require(refusal.text.find("nothing is known") == std::string::npos, "nobody has decided: {}", refusal.text);
  }
  try {
    const Model model(options);
  } catch (const RefusedOptions& refused) {
    require(refused.refusals.size() == found.size(), "the constructor refuses something else: {}", refused.what());
    return;
  }
  throw Broken("a model is made of options that exclude each other");
}

// ---- How the model of a pair of options is stepped ----

int scenes() {
  const char* text = std::getenv("SHEARBUS_COMBINATION_SCENES");
  return text != nullptr ? std::atoi(text) : 1;
}

constexpr int kHistorySteps = 10;
constexpr int kTwinSteps = 3;
// Steps under a tolerance that need more evaluations than this are not compared: the reference solver takes minutes.
constexpr int kMostEffort = 3000;
constexpr double kStep = 1e-9;  // step length [s]

// Sets inputs under which the bodies slide, at 2 GPa. At this pressure friction limits the stress if the friction
// coefficient is small, otherwise the yield strength does.
void slide(Rig& rig) {
  rig.set_all(100.0, 2e9);
  for (int l = 0; l < kLanes; ++l) rig.inputs.mass_soft[l] = rig.inputs.mass_hard[l] = 1.0 + l;
}

// Keeps the bodies at rest for enough steps that nodes may fall asleep, and checks the invariants in every step.
void rest(Rig& rig, Figures& figures) {
  rig.set_all(0.0, 2e9);
  for (int l = 0; l < kLanes; ++l) rig.inputs.stress_soft[l] = rig.inputs.stress_hard[l] = 0.0;
  for (int n = 0; n < 24; ++n) {
    rig.step(kStep);
    for (int l = 0; l < kLanes; ++l) require_invariants(rig, l, kStep, figures);
  }
}

struct TwinStep {
  reference::NodeState state;
  reference::NodeOutputs outputs;
};

// Steps the rig, and lane `l` also by the reference solver with `twin_options`. Returns nothing if the two answers
// cannot be compared: the lane sleeps, the step has several answers, or the reference solver would take too long.
std::optional<TwinStep> step_both(Rig& rig, const ModelOptions& twin_options, int l, double dt) {
  const ModelOptions& options = rig.model.options();
  const bool slept = rig.slept(l);
  TwinStep twin;
  if (!slept) twin.state = rig.node_state(l);
  reference::NodeInputs inputs = rig.node_inputs(l);
  const reference::NodeState before = twin.state;
  SearchEffort effort;
  rig.inputs.effort = &effort;
  rig.step(dt);
  rig.inputs.effort = nullptr;
  if (slept || rig.slept(l) || (rig.outputs.outcome[l] & (kSubstepped | kMultipleRoots)) != 0) return {};
  if (options.tolerance && effort.layer_sums + effort.limit_values > kMostEffort) return {};
  const bool first_order = (rig.outputs.outcome[l] & kFirstOrder) != 0;
  twin.outputs = reference::advance_one(twin_options, dt, inputs, twin.state);
  // If the fast solver could not show that its answer is unique it fell back to the first-order scheme, perhaps without
  // need. If the reference solver did not fall back, it now repeats the step with the first-order scheme.
  if (!options.tolerance && first_order && !twin.outputs.first_order) {
    inputs.backward_euler = true;
    twin.state = before;
    twin.outputs = reference::advance_one(twin_options, dt, inputs, twin.state);
  }
  if (twin.outputs.answers > 1) return {};
  return twin;
}

void require_twin(Rig& rig, int l, double dt, long& compared) {
  const ModelOptions& options = rig.model.options();
  const bool flows = rig.model.layout().plastic_strain != TileLayout::kAbsent;
  std::vector<double> strain;
  for (int i = 0; i < rig.model.grid().num_vertices(); ++i) strain.push_back(flows ? rig.ep(i, l) : 0.0);
  const std::optional<TwinStep> twin = step_both(rig, options, l, dt);
  if (!twin) return;
  ++compared;
  if (options.tolerance) {  // with a tolerance the error of T0 of either solver may be as large as its error estimate
    const double range = options.soft.melting_temperature - options.initial_temperature;
    require_near(rig.outputs.interface_temperature[l], twin->outputs.interface_temperature,
                 range * (rig.outputs.error_estimate[l] + twin->outputs.error_estimate) + 1e-8, "T0 under a tolerance");
    return;
  }
  if (options.inertia) {  // the stress varies with z: only s at z = 0 is compared; PhysicsWavesReference compares all
    require_near(rig.outputs.shear_stress[l], twin->outputs.shear_stress,
                 1e-6 * std::abs(twin->outputs.shear_stress) + 1.0, "s of a layer with inertia");
    return;
  }
  Worst worst;
  require_agreement(rig, strain, twin->outputs, twin->state, l, dt, worst);
}

struct Counts {
  long steps = 0, compared = 0;
};

// Steps one model through random histories and states, checked by all invariants. Then compares some of its steps with
// the reference solver.
void require_sound_model(Draw& draw, const ModelOptions& options, Counts& counts) {
  Figures figures;
  {
    Rig rig(options);
    if (draw.chance(0.5)) random_state(draw, rig);
    random_history(draw, rig, false, options.tolerance ? 3 : kHistorySteps, figures, [](double) {});
  }
  Rig rig(options);
  slide(rig);
  for (int n = 0; n < kTwinSteps; ++n) require_twin(rig, n % 3, kStep, counts.compared);
  rest(rig, figures);
  for (int n = 0; n < kTwinSteps; ++n) {
    random_inputs(draw, rig, false);
    require_twin(rig, n % 3, std::max(random_dt(draw, false), shortest_step(options)), counts.compared);
  }
  counts.steps += figures.node_steps;
}

// ---- The tests of all pairs of options and laws ----

struct Case {
  Strategy strategy;
  std::size_t item;
};

std::string name_of(const Case& c) {
  std::string name = c.strategy == Strategy::kVelocityDriven ? "VelocityDriven_" : "ForceDriven_";
  const std::vector<Item> all = items();
  for (const char letter : all[c.item].name) name += std::isalnum(static_cast<unsigned char>(letter)) ? letter : '_';
  return name;
}

std::vector<Case> cases(bool laws_only) {
  const std::vector<Item> list = items();
  std::vector<Case> all;
  for (const Strategy strategy : {Strategy::kVelocityDriven, Strategy::kForceDriven})
    for (std::size_t i = 0; i < list.size(); ++i)
      if (!laws_only || list[i].kind != Kind::kOption) all.push_back({strategy, i});
  return all;
}

// Each pair has a history of its own, so that a new option or law leaves those of other pairs as they were.
std::uint64_t seed_of(Strategy strategy, const Item& a, const Item& b, int scene) {
  std::uint64_t hash = 14695981039346656037U;  // FNV-1a
  const std::string text = a.name + '/' + b.name + '/' + std::to_string(scene);
  for (const char c : text) hash = (hash ^ static_cast<unsigned char>(c)) * 1099511628211U;
  return hash + (strategy == Strategy::kForceDriven ? 1 : 0);
}

class PhysicsCombinations : public ::testing::TestWithParam<Case> {};

TEST_P(PhysicsCombinations, EachPairIsRefusedWithItsReasonOrHolds) {
  const auto [strategy, first] = GetParam();
  const std::vector<Item> all = items();
  Counts counts;
  int made = 0, refused = 0;
  for (std::size_t second = first; second < all.size(); ++second) {  // the pair with second == first is the item alone
    for (int scene = 0; scene < 2 * scenes(); ++scene) {
      SCOPED_TRACE(all[first].name + " and " + all[second].name);
      const bool rubs = scene % 2 == 0;
      Draw draw(seed_of(strategy, all[first], all[second], scene));
      try {
        const std::optional<ModelOptions> options = possible(strategy, {&all[first], &all[second]}, all, rubs);
        if (options) {
          require_sound_model(draw, *options, counts);
          ++made;
        } else {
          require_refusal(combined(strategy, {&all[first], &all[second]}, rubs));
          ++refused;
        }
      } catch (const Broken& broken) {
        ADD_FAILURE() << broken.what();
      }
    }
  }
  std::printf("%d models of pairs, %d refused; %ld node-steps held, %ld compared with the twin\n", made, refused,
              counts.steps, counts.compared);
  if (made > 0) {
    EXPECT_GT(counts.compared, 2 * made);
  }
}

// ---- Larger sets of options and laws ----

// A random set of items that may be on together, besides the strategy.
ModelOptions larger_set(Draw& draw, std::string& names) {
  const std::vector<Item> all = items();
  const Strategy strategy = draw.chance(0.5) ? Strategy::kVelocityDriven : Strategy::kForceDriven;
  const bool rubs = draw.chance(0.5);
  const int most = draw.integer(3, 8);
  std::vector<const Item*> chosen;
  ModelOptions options = combined(strategy, {}, rubs);
  for (int tries = 0; tries < 60 && static_cast<int>(chosen.size()) < most; ++tries) {
    const Item& item = all[static_cast<std::size_t>(draw.integer(0, static_cast<int>(all.size()) - 1))];
    if (std::find(chosen.begin(), chosen.end(), &item) != chosen.end()) continue;
    std::vector<const Item*> more = chosen;
    more.push_back(&item);
    const ModelOptions with = combined(strategy, more, rubs);
    const Properties on = properties_of(with);
    const auto kept = [&](const Part& part) {
      return !properties_of(options).has(part.property) || on.has(part.property);
    };
    if (!refusals(with).empty() || !std::all_of(parts().begin(), parts().end(),
                                                [&](const Part& part) { return part.set == nullptr || kept(part); }))
      continue;
    chosen = more;
    options = with;
  }
  names = strategy == Strategy::kForceDriven ? "force-driven" : "velocity-driven";
  for (const Item* item : chosen) names += ", " + item->name;
  return options;
}

// What no host would send: steps of 1e-15 to 1e-4 s, jumps to 1e5 m/s, pressures to 300 GPa, contacts that open in every
// other step, masses from 1e-6 to 1e6 kg/m2.
void draw_anything(Draw& draw, Rig& rig) {
  for (int l = 0; l < kLanes; ++l) {
    TileInputs& in = rig.inputs;
    const auto any = [&](double least, double most) {
      return draw.chance(0.1) ? 0.0 : draw.sign() * draw.log_uniform(least, most);
    };
    in.velocity_jump[l] = any(1e-9, 1e5);
    in.second_velocity_jump[l] = any(1e-9, 1e5);
    in.pressure[l] = draw.chance(0.5) ? -draw.log_uniform(1.0, 20e9) : draw.log_uniform(1.0, 300e9);
    for (double* stress : {in.stress_soft, in.stress_hard, in.second_stress_soft, in.second_stress_hard})
      stress[l] = any(1.0, 1e12);
    in.mass_soft[l] = draw.log_uniform(1e-6, 1e6);
    in.mass_hard[l] = draw.log_uniform(1e-6, 1e6);
    in.soft_shear_rate[l] = any(1.0, 1e12);
    in.soft_plastic_strain_rate[l] = any(1.0, 1e10);
    in.second_soft_plastic_strain_rate[l] = any(1.0, 1e10);
  }
}

// Of each answer of extreme inputs: numbers, no negative heat, no work of friction on the bodies. Returns the number of
// lanes that found no answer, and kept their state.
int require_an_answer(const Rig& rig) {
  int failed = 0;
  for (int l = 0; l < kLanes; ++l) {
    const TileOutputs& out = rig.outputs;
    failed += (out.outcome[l] & kFailed) != 0;
    for (const double x : {out.shear_stress[l], out.sliding_velocity[l], out.interface_temperature[l],
                           out.velocity_jump_new[l], out.friction_heat[l]})
      require(std::isfinite(x), "lane {}: {} is no number", l, x);
    require(out.friction_heat[l] >= 0.0, "lane {}: heat {}", l, out.friction_heat[l]);
    require(out.shear_stress[l] * out.sliding_velocity[l] >= 0.0, "lane {}: s {} against [v] {}", l,
            out.shear_stress[l], out.sliding_velocity[l]);
  }
  return failed;
}

// SHEARBUS_LARGER_SETS sets the number of sets.
TEST(PhysicsLargerSets, HoldAndAnswerAnything) {
  const char* text = std::getenv("SHEARBUS_LARGER_SETS");
  const int sets = text != nullptr ? std::atoi(text) : 20;
  Draw draw(77);
  Counts counts;
  long answered = 0, failed = 0;
  for (int set = 0; set < sets; ++set) {
    std::string names;
    const ModelOptions options = larger_set(draw, names);
    SCOPED_TRACE(names);
    try {
      require_sound_model(draw, options, counts);
      Rig rig(options);
      for (int n = 0; n < (options.tolerance ? 3 : 20); ++n) {
        draw_anything(draw, rig);
        rig.step(std::max(draw.log_uniform(1e-15, 1e-4), shortest_step(options)));
        failed += require_an_answer(rig);
        answered += kLanes;
      }
    } catch (const Broken& broken) {
      ADD_FAILURE() << broken.what();
    }
  }
  std::printf(
      "%d sets: %ld node-steps held, %ld compared with the twin; of %ld with extreme inputs %ld without an answer\n",
      sets, counts.steps, counts.compared, answered, failed);
  EXPECT_LE(failed, answered / 200);
  EXPECT_GT(counts.compared, sets);
}

// Shows that the comparison with the reference solver finds a solver that uses the default law in place of the chosen
// law. Here it is the reference solver that gets the default law.
class PhysicsForgottenLaws : public ::testing::TestWithParam<Case> {};

TEST_P(PhysicsForgottenLaws, AreSeenWithEveryOption) {
  const auto [strategy, first] = GetParam();
  const std::vector<Item> all = items();
  // A friction law affects the stress only where friction limits it, a flow law only where the yield stress of the
  // interface or the layer limits it.
  const bool is_friction = all[first].kind == Kind::kFrictionLaw;
  int made = 0;
  for (const Item& other : all) {
    if (other.kind != Kind::kOption && &other != &all[first]) continue;
    const std::optional<ModelOptions> options = possible(strategy, {&all[first], &other}, all, is_friction);
    if (!options) continue;
    ++made;
    ModelOptions forgetful = *options;
    if (is_friction)
      forgetful.interface.friction_law = FrictionLaw{};
    else
      forgetful.soft = with_strength_of(forgetful.soft, paper_options().soft);
    Rig rig(*options);
    slide(rig);
    bool seen = false;
    for (int n = 0; n < 6 && !seen; ++n) {
      const std::optional<TwinStep> twin = step_both(rig, forgetful, 0, kStep);
      if (!twin) continue;
      const double s = rig.outputs.shear_stress[0];
      seen = std::abs(s - twin->outputs.shear_stress) > 1e-4 * std::abs(s);
    }
    EXPECT_TRUE(seen) << all[first].name << " with " << other.name << ": the stress of the default law fits as well";
  }
  std::printf("%d models\n", made);
}

INSTANTIATE_TEST_SUITE_P(, PhysicsCombinations, ::testing::ValuesIn(cases(false)),
                         [](const auto& test) { return name_of(test.param); });
INSTANTIATE_TEST_SUITE_P(, PhysicsForgottenLaws, ::testing::ValuesIn(cases(true)),
                         [](const auto& test) { return name_of(test.param); });

// A row is removed from the table of exclusions. Its pair of properties is then neither allowed nor excluded, and must
// be refused nevertheless.
TEST(PhysicsExclusions, APairWhoseExclusionIsMissingIsRefusedAllTheSame) {
  const std::span<const Exclusion> all = exclusions();
  const std::vector<Item> list = items();
  int tried = 0;
  for (std::size_t k = 0; k < all.size(); ++k) {
    std::vector<Exclusion> others(all.begin(), all.end());
    others.erase(others.begin() + static_cast<std::ptrdiff_t>(k));
    const auto of_pair = [&](const Properties& on) {
      for (const Part& a : parts())
        for (const Part& b : parts())
          if (all[k].first.has(a.property) && all[k].second.has(b.property) && on.has(a.property) && on.has(b.property))
            return true;
      return false;
    };
    for (const Part& a : parts())
      for (const Part& b : parts())
        if (all[k].first.has(a.property) && all[k].second.has(b.property)) {
          EXPECT_FALSE(go_together(a, b, others)) << all[k].reason;
        }
    EXPECT_GT(all[k].reason.size(), 20U) << all[k].reason;
    for (const Strategy strategy : {Strategy::kVelocityDriven, Strategy::kForceDriven})
      for (const Item& a : list)
        for (const Item& b : list) {
          const ModelOptions options = combined(strategy, {&a, &b}, true);
          const Properties on = properties_of(options);
          if (!of_pair(on)) continue;
          EXPECT_FALSE(refusals(options, parts(), others).empty()) << a.name << ", " << b.name;
          ++tried;
        }
  }
  EXPECT_GT(tried, 100);
}

// What a user meets: reasons, each of which may name several options.
TEST(PhysicsExclusions, AreFew) {
  EXPECT_LE(exclusions().size(), 17U);
}

// A property that the table of exclusions does not mention, as a new law or option may have, must be refused in every
// scene.
TEST(PhysicsExclusions, APropertyThatNoRowHasDecidedAboutIsRefusedEverywhere) {
  std::vector<Part> more(parts().begin(), parts().end());
  more.push_back({.property = static_cast<Property>(kProperties),
                  .key = "interface.friction_law",
                  .is_on = [](const ModelOptions&) { return true; }});
  for (const Strategy strategy : {Strategy::kVelocityDriven, Strategy::kForceDriven}) {
    const std::vector<Refusal> found = refusals(combined(strategy, {}, true), more, exclusions());
    ASSERT_FALSE(found.empty());
    for (const Refusal& refusal : found) EXPECT_NE(refusal.text.find("nothing is known"), std::string::npos);
  }
}

// ---- Incomplete friction laws, which must not satisfy FrictionLawClass ----

struct CompleteLaw : ConstantFriction {};
static_assert(FrictionLawClass<CompleteLaw>);

// An incomplete friction law: it does not declare whether it depends on slip.
struct ForgetfulLaw {
  [[maybe_unused]] static constexpr std::string_view kName = "forgetful", kEquation{}, kAdds{}, kWhen{};
  [[maybe_unused]] static constexpr bool kDependsOnTemperature = false;
  static LawFault fault_of(const InterfaceOptions&, const Material&) { return {}; }
  static InterfaceOptions typical(const InterfaceOptions& options, const Material&) { return options; }
  static FrictionValue at(const InterfaceOptions&, const Material&, const ContactPoint&) { return {0.1}; }
};
static_assert(!FrictionLawClass<ForgetfulLaw>);

// An incomplete friction law: it depends on the temperature, but gives no bound of its slope. Without this bound no
// search can know whether an answer is the only one.
struct UnboundedLaw : CompleteLaw {
  static constexpr bool kDependsOnTemperature = true;
};
static_assert(!FrictionLawClass<UnboundedLaw>);

// An incomplete friction law: it has a state, but does not advance it.
struct FrozenLaw : CompleteLaw {
  static constexpr StateVariable kStates[] = {{"frozen", "1"}};
};
static_assert(!FrictionLawClass<FrozenLaw>);

}  // namespace
}  // namespace shearbus::testing
