// Invalid requests through the wire: each refusal names the fault and leaves the states unchanged, bit for bit.
#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "tests/support/changed_scene.hpp"
#include "tests/support/service_harness.hpp"

namespace shearbus::service {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();
const std::vector<std::uint64_t> kNodes = support::node_ids(20);

struct Case {
  std::string name;
  Code code;
  std::string field;
  std::vector<std::uint64_t> nodes;
  std::function<wire::Request()> request;  // makes the request that must be refused; its sequence number is 2
};

wire::Batch good(Strategy strategy, bool with_ids = false) {
  return support::step_columns(strategy, kNodes, 2, with_ids);
}

Case value(Strategy strategy, Field field, double bad) {
  return {std::string(wire::name(field)) + "=" + std::to_string(bad),
          Code::kInvalidValue,
          wire::name(field),
          {103, 117},
          [=] {
            auto batch = good(strategy);
            batch.f64(field)[3] = bad;
            batch.f64(field)[17] = bad;
            return ServiceHarness::step(2, std::move(batch));
          }};
}

Case dt(double bad) {
  return {"dt=" + std::to_string(bad), Code::kInvalidValue, "dt_s", {}, [=] {
            auto request = ServiceHarness::step(2, good(Strategy::kForceDriven));
            std::get<wire::Downscale>(request.body).dt_s = bad;
            return request;
          }};
}

Case shape(std::string name, Code code, Field field, std::function<wire::Batch()> batch,
           std::vector<std::uint64_t> nodes = {}) {
  return {std::move(name), code, wire::name(field), std::move(nodes), [=] { return ServiceHarness::step(2, batch()); }};
}

wire::Batch without(Strategy strategy, Field dropped) {
  std::vector<Field> fields;
  for (const Field field : wire::columns_of(strategy).required)
    if (field != dropped) fields.push_back(field);
  return wire::Batch::of(fields, kNodes.size());
}

wire::Batch with(Strategy strategy, Field added) {
  const auto required = wire::columns_of(strategy).required;
  std::vector<Field> fields(required.begin(), required.end());
  fields.push_back(added);
  wire::Batch batch = wire::Batch::of(fields, kNodes.size());
  for (const Field field : required)
    for (std::size_t row = 0; row < kNodes.size(); ++row)
      batch.f64(field)[row] = support::input_of(field, kNodes[row], 2);
  return batch;
}

// A batch whose columns have the right names and lie in one block of memory; the first column is one element shorter
// than the others.
wire::Batch uneven() {
  static const wire::Batch whole = good(Strategy::kForceDriven);
  auto columns = whole.columns();
  columns.front().count -= 1;
  return wire::Batch::over(columns, whole.bytes());
}

wire::Batch ids_with(std::size_t row, std::uint64_t id) {
  auto batch = good(Strategy::kForceDriven, true);
  batch.u64(Field::kNodeId)[row] = id;
  return batch;
}

std::vector<Case> force_driven_cases() {
  std::vector<Case> cases;
  for (const Field field : wire::columns_of(Strategy::kForceDriven).required)
    for (const double bad : {kNan, kInf, -kInf, 1e300}) cases.push_back(value(Strategy::kForceDriven, field, bad));
  for (const Field field : {Field::kMassSoft, Field::kMassHard})
    for (const double bad : {0.0, -1.0, 5e-324, 1e-30, 1e30})
      cases.push_back(value(Strategy::kForceDriven, field, bad));
  // Values in other units.
  for (const auto& [field, bad] :
       {std::pair{Field::kPressure, 11.2e12}, {Field::kVelocityJump, 1e7}, {Field::kStressSoft, -1e13}})
    cases.push_back(value(Strategy::kForceDriven, field, bad));
  for (const double bad : {0.0, -1e-9, 1.5, kNan, kInf, 5e-324}) cases.push_back(dt(bad));
  cases.push_back(shape("missing", Code::kShape, Field::kMassHard,
                        [] { return without(Strategy::kForceDriven, Field::kMassHard); }));
  cases.push_back(shape("surplus", Code::kShape, Field::kSoftShearRate,
                        [] { return with(Strategy::kForceDriven, Field::kSoftShearRate); }));
  cases.push_back(shape("reply column", Code::kShape, Field::kShearStress,
                        [] { return with(Strategy::kForceDriven, Field::kShearStress); }));
  cases.push_back(shape("plastic rate", Code::kUnsupported, Field::kSoftPlasticStrainRate,
                        [] { return with(Strategy::kForceDriven, Field::kSoftPlasticStrainRate); }));
  cases.push_back(shape("uneven", Code::kShape, Field::kVelocityJump, uneven));
  cases.push_back(shape("too few rows", Code::kShape, Field::kVelocityJump,
                        [] { return support::step_columns(Strategy::kForceDriven, std::span(kNodes).first(19), 2); }));
  cases.push_back(shape("no payload", Code::kShape, Field::kVelocityJump, [] { return wire::Batch(); }));
  cases.push_back(shape("unknown node", Code::kUnknownNode, Field::kNodeId, [] { return ids_with(5, 4711); }, {4711}));
  cases.push_back(
      shape("duplicate node", Code::kDuplicateNode, Field::kNodeId, [] { return ids_with(5, 100); }, {100}));
  cases.push_back({"second component", Code::kUnsupported, "velocity_jump_m_per_s", {}, [] {
                     static const wire::Batch whole = good(Strategy::kForceDriven);
                     auto columns = whole.columns();
                     columns.front().component = 1;
                     return ServiceHarness::step(2, wire::Batch::over(columns, whole.bytes()));
                   }});
  cases.push_back({"unspecified mode", Code::kMalformed, "downscale.mode", {}, [] {
                     return ServiceHarness::step(2, good(Strategy::kForceDriven), wire::Mode::kUnspecified);
                   }});
  cases.push_back({"infinite time", Code::kInvalidValue, "time_s", {}, [] {
                     auto request = ServiceHarness::step(2, good(Strategy::kForceDriven));
                     std::get<wire::Downscale>(request.body).time_s = kInf;
                     return request;
                   }});
  for (const auto& wanted : {std::vector{Field::kPressure}, std::vector{Field::kRegime, Field::kRegime}})
    cases.push_back({"wanted", Code::kShape, "wanted", {}, [=] {
                       auto request = ServiceHarness::step(2, good(Strategy::kForceDriven));
                       std::get<wire::Downscale>(request.body).wanted = wanted;
                       return request;
                     }});
  cases.push_back({"payload with commit", Code::kShape, "payload", {}, [] {
                     auto request = ServiceHarness::in_session(wire::Commit{}, 2);
                     request.batch = good(Strategy::kForceDriven);
                     return request;
                   }});
  return cases;
}

std::vector<Case> velocity_driven_cases() {
  std::vector<Case> cases;
  for (const Field field : wire::columns_of(Strategy::kVelocityDriven).required)
    for (const double bad : {kNan, kInf, 1e300}) cases.push_back(value(Strategy::kVelocityDriven, field, bad));
  cases.push_back(shape("shear rate without its drive", Code::kShape, Field::kSoftShearRate,
                        [] { return with(Strategy::kVelocityDriven, Field::kSoftShearRate); }));
  cases.push_back(shape("force column", Code::kShape, Field::kMassSoft,
                        [] { return with(Strategy::kVelocityDriven, Field::kMassSoft); }));
  return cases;
}

void expect_refused_and_unchanged(Strategy strategy, const std::vector<Case>& cases) {
  ServiceHarness attacked(2), twin(2);
  for (ServiceHarness* h : {&attacked, &twin}) {
    h->granted(ServiceHarness::opening(support::scene_of(strategy), kNodes));
    h->granted(ServiceHarness::step(1, support::step_columns(strategy, kNodes, 1)));
  }
  std::uint64_t refused = 0;
  for (const Case& c : cases) {
    SCOPED_TRACE(c.name);
    const Answer answer = attacked.ask(c.request());
    EXPECT_EQ(answer.code(), c.code) << describe(answer.reply.status);
    EXPECT_EQ(answer.reply.status.field, c.field);
    EXPECT_EQ(answer.reply.status.node_ids, c.nodes);
    EXPECT_FALSE(answer.reply.status.text.empty());
    EXPECT_EQ(answer.reply.request_id, 1002u);
    EXPECT_FALSE(answer.frames.has_payload);
    EXPECT_EQ(attacked.service.status().refused, ++refused);
  }
  for (std::uint64_t sequence = 2; sequence < 8; ++sequence) {
    const int step = static_cast<int>(sequence);
    const Answer a = attacked.ask(ServiceHarness::step(sequence, support::step_columns(strategy, kNodes, step)));
    const Answer b = twin.ask(ServiceHarness::step(sequence, support::step_columns(strategy, kNodes, step)));
    ASSERT_TRUE(a.reply.status.ok());
    ASSERT_EQ(a.payload(), b.payload()) << "step " << step;
  }
}

TEST(Refusals, ForceDrivenStepsAreRefusedWhole) {
  expect_refused_and_unchanged(Strategy::kForceDriven, force_driven_cases());
}
TEST(Refusals, VelocityDrivenStepsAreRefusedWhole) {
  expect_refused_and_unchanged(Strategy::kVelocityDriven, velocity_driven_cases());
}

TEST(Refusals, AtMostSixteenNodesAreNamed) {
  const auto nodes = support::node_ids(40);
  ServiceHarness harness;
  harness.ask(ServiceHarness::opening(support::velocity_scene(), nodes));
  auto batch = support::step_columns(Strategy::kVelocityDriven, nodes, 1);
  std::ranges::fill(batch.f64(Field::kPressure), kNan);
  const Answer answer = harness.ask(ServiceHarness::step(1, std::move(batch)));
  EXPECT_EQ(answer.reply.status.node_ids, support::node_ids(16));
  EXPECT_NE(answer.reply.status.text.find("40 of 40"), std::string::npos);
  EXPECT_NE(answer.reply.status.text.find("pressure_pa of node 100 is nan"), std::string::npos)
      << answer.reply.status.text;
}

// Rates of the host that a scene takes: they reach the layer, and each has values that are refused.
TEST(Refusals, ARateOfTheHostIsTakenByTheSceneThatHasAUseForIt) {
  struct Taken {
    v1::Scene scene;
    Field rate;
    double bad;
  };
  for (const auto& [scene, rate, bad] :
       {Taken{support::with(support::velocity_scene(), "velocity_driven { drive: DRIVE_INTERFACE_SLIP }"),
              Field::kSoftShearRate, kNan},
        Taken{support::with(support::force_scene(), "interface { plastic_layer: true }"), Field::kSoftPlasticStrainRate,
              -2e15}}) {
    SCOPED_TRACE(wire::name(rate));
    double slip[2];
    for (const int driven : {0, 1}) {
      ServiceHarness harness;
      harness.ask(ServiceHarness::opening(scene, kNodes));
      auto batch = with(support::strategy_of(scene), rate);
      std::ranges::fill(batch.f64(rate), driven * 1e5);
      const Answer answer = harness.granted(ServiceHarness::step(1, std::move(batch)));
      slip[driven] = answer.reply.batch.f64(Field::kSlidingVelocity)[0];
      auto refused = with(support::strategy_of(scene), rate);
      refused.f64(rate)[4] = bad;
      EXPECT_EQ(harness.ask(ServiceHarness::step(2, std::move(refused))).reply.status.field, wire::name(rate));
    }
    if (rate == Field::kSoftPlasticStrainRate) {
      EXPECT_GT(std::abs(slip[1]), std::abs(slip[0]) + 1.0);  // 1e5/s adds sqrt(3) h 1e5/s = 3.5 m/s
    }
  }
}

TEST(Refusals, PlasticStrainRateOfTwoComponentsHasBoth) {
  const v1::Scene scene =
      support::with(support::force_scene(), "tangential_components: 2 interface { plastic_layer: true }");
  ServiceHarness harness;
  harness.ask(ServiceHarness::opening(scene, kNodes));
  std::vector<Field> fields(wire::columns_of(Strategy::kForceDriven).required.begin(),
                            wire::columns_of(Strategy::kForceDriven).required.end());
  fields.push_back(Field::kSoftPlasticStrainRate);
  const wire::Batch scalar = with(Strategy::kForceDriven, Field::kSoftPlasticStrainRate);
  wire::Batch whole = wire::Batch::of(fields, kNodes.size(), 2);
  for (const wire::Column& column : whole.columns())
    std::ranges::copy(scalar.f64(column.field), whole.f64(column.field, column.component).begin());
  std::ranges::fill(whole.f64(Field::kSoftPlasticStrainRate), -1e5);
  for (const std::uint32_t dropped : {0U, 1U}) {
    auto columns = whole.columns();
    std::erase_if(columns, [&](const wire::Column& column) {
      return column.field == Field::kSoftPlasticStrainRate && column.component == dropped;
    });
    const wire::Status refusal =
        harness.ask(ServiceHarness::step(1, wire::Batch::over(columns, whole.bytes()))).reply.status;
    EXPECT_EQ(refusal.code, Code::kShape);
    EXPECT_EQ(refusal.field, "soft_plastic_strain_rate_per_s");
  }
  harness.granted(ServiceHarness::step(1, std::move(whole)));
}

wire::Batch opening_columns(std::vector<std::uint64_t> ids, std::vector<double> temperatures = {}) {
  std::vector<Field> fields = {Field::kNodeId};
  if (!temperatures.empty()) fields.push_back(Field::kInitialTemperature);
  wire::Batch batch = wire::Batch::of(fields, ids.size());
  std::ranges::copy(ids, batch.u64(Field::kNodeId).begin());
  std::ranges::copy(temperatures, batch.f64(Field::kInitialTemperature).begin());
  return batch;
}

TEST(Refusals, OpeningsAreRefusedWhole) {
  struct Opening {
    const char* name;
    Code code;
    const char* field;
    const char* scene;  // changes of the scene
    std::function<void(wire::Request&)> damage = [](wire::Request&) {};
  };
  const auto columns = [](std::vector<std::uint64_t> ids, std::vector<double> temperatures = {}) {
    return [=](wire::Request& request) { request.batch = opening_columns(ids, temperatures); };
  };
  ServiceHarness harness;
  for (const Opening& c : {
           Opening{"unknown material", Code::kInvalidScene, "soft.material", "soft { material: 'aluminum_dlp' }"},
           Opening{"unknown hard material", Code::kInvalidScene, "hard.material", "hard { material: 'mithril' }"},
           Opening{"negative strength", Code::kInvalidScene, "soft.yield_strength_pa",
                   "soft { yield_strength_pa: -1 }"},
           Opening{"NaN constant", Code::kInvalidScene, "hard.density_kg_per_m3", "hard { density_kg_per_m3: nan }"},
           Opening{"n = 0", Code::kInvalidScene, "soft.hardening_exponent", "soft { hardening_exponent: 0 }"},
           Opening{"beta < 0", Code::kInvalidScene, "soft.hardening_coefficient", "soft { hardening_coefficient: -1 }"},
           Opening{"k < 0", Code::kInvalidScene, "soft.thermal_conductivity_w_per_m_k",
                   "soft { thermal_conductivity_w_per_m_k: -117 }"},
           Opening{"alpha = 0", Code::kInvalidScene, "soft.thermal_diffusivity_m2_per_s",
                   "soft { thermal_diffusivity_m2_per_s: 0 }"},
           Opening{"T_melt infinite", Code::kInvalidScene, "soft.melting_temperature_k",
                   "soft { melting_temperature_k: inf }"},
           Opening{"h = 0", Code::kInvalidScene, "layer.thickness_m", "layer { thickness_m: 0 }"},
           Opening{"no cells", Code::kInvalidScene, "layer.cells", "layer { cells: 0 }"},
           Opening{"cells beyond any memory", Code::kInvalidScene, "layer.cells", "layer { cells: 4000000000 }"},
           Opening{"cells finer towards the far end", Code::kInvalidScene, "layer.grading", "layer { grading: 0.5 }"},
           Opening{"mu < 0", Code::kInvalidScene, "interface.friction_coefficient",
                   "interface { friction_coefficient: -0.3 }"},
           Opening{"no yield strength of the interface", Code::kInvalidScene, "interface.yield_strength_pa",
                   "strategy: STRATEGY_FORCE_DRIVEN interface { friction_coefficient: 0.3 yield_strength_pa: 0 }"},
           Opening{"too hot", Code::kInvalidScene, "layer.initial_temperature_k",
                   "layer { initial_temperature_k: 1220 }"},
           Opening{"below zero", Code::kInvalidScene, "layer.initial_temperature_k",
                   "layer { initial_temperature_k: -3 }"},
           Opening{"no strategy", Code::kInvalidScene, "", "",  // a missing key is reported at its table
                   [](wire::Request& r) {
                     v1::Scene scene = support::velocity_scene();
                     scene.clear_strategy();
                     std::get<wire::OpenSession>(r.body).scene = support::text_of(scene);
                   }},
           Opening{"force-driven without interface", Code::kInvalidScene, "strategy",
                   "strategy: STRATEGY_FORCE_DRIVEN"},
           Opening{"no id", Code::kInvalidValue, "session_id", "",
                   [](wire::Request& r) { std::get<wire::OpenSession>(r.body).session_id = {}; }},
           Opening{"no nodes", Code::kShape, "node_id", "", [](wire::Request& r) { r.batch = wire::Batch(); }},
           Opening{"empty nodes", Code::kShape, "node_id", "", columns({})},
           Opening{"twice the same node", Code::kDuplicateNode, "node_id", "", columns({7, 8, 7})},
           Opening{"too many nodes", Code::kLimit, "node_id", "",
                   columns(support::node_ids(wire::kMaxNodesPerSession + 1))},
           Opening{"a molten node", Code::kInvalidValue, "initial_temperature_k", "", columns({7, 8}, {300, 1300})},
           Opening{"a node below absolute zero", Code::kInvalidValue, "initial_temperature_k", "",
                   columns({7, 8}, {-300, 300})},
           Opening{"a foreign column", Code::kShape, "pressure_pa", "",
                   [](wire::Request& r) {
                     r.batch = wire::Batch::of(std::vector{Field::kNodeId, Field::kPressure}, 2);
                   }},
           Opening{"a sequence", Code::kSequenceGap, "", "", [](wire::Request& r) { r.sequence = 4; }},
       }) {
    SCOPED_TRACE(c.name);
    auto request = ServiceHarness::opening(support::with(support::velocity_scene(), c.scene), kNodes);
    c.damage(request);
    const Answer answer = harness.ask(request);
    EXPECT_EQ(answer.code(), c.code) << describe(answer.reply.status);
    EXPECT_EQ(answer.reply.status.field, c.field) << describe(answer.reply.status);
    EXPECT_EQ(harness.service.status().sessions, 0u);
    EXPECT_EQ(harness.service.status().state_bytes, 0u);
  }
  EXPECT_TRUE(harness.ask(ServiceHarness::opening(support::velocity_scene(), kNodes)).reply.status.ok());
}

// Frames that are no valid request: no frame, a header without its payload, three frames, an empty header, two headers
// in one frame, text of another protocol, a header or a payload that is cut short, a payload with a flipped bit.
TEST(Refusals, DamagedFramesAreAnsweredAndRunNothing) {
  ServiceHarness attacked, twin;
  for (ServiceHarness* h : {&attacked, &twin}) h->granted(ServiceHarness::opening(support::force_scene(), kNodes));
  const auto request = ServiceHarness::step(1, support::step_columns(Strategy::kForceDriven, kNodes, 1));
  const std::string header = wire::encode_header(request);
  const auto payload = request.batch.bytes();
  const auto bytes = [](const std::string& text) { return std::as_bytes(std::span(text)); };
  const auto refused = [&](std::vector<std::span<const std::byte>> frames) {
    const Answer answer = attacked.ask_bytes(frames);
    EXPECT_FALSE(answer.reply.status.ok());
    EXPECT_LT(static_cast<int>(answer.code()), 200) << describe(answer.reply.status);
  };
  refused({});
  refused({bytes(header)});
  refused({bytes(header), payload, payload});
  refused({{}});
  refused({{}, bytes(header), payload});
  const std::string twice = header + header;
  refused({bytes(twice), payload});
  const std::string http = "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n";
  refused({bytes(http)});
  for (std::size_t length = 0; length < header.size(); ++length) refused({bytes(header).first(length), payload});
  for (std::size_t length = 0; length < payload.size(); length += 7) refused({bytes(header), payload.first(length)});
  auto flipped = support::bytes_of(request.batch);
  for (std::size_t i = 0; i < flipped.size(); i += 13) {
    flipped[i] ^= std::byte{1};
    refused({bytes(header), flipped});
    flipped[i] ^= std::byte{1};
  }
  EXPECT_EQ(attacked.ask(request).payload(), twin.ask(request).payload());
  EXPECT_EQ(attacked.service.status().node_steps, kNodes.size());
}

}  // namespace
}  // namespace shearbus::service
