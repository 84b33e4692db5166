// Small scenes, velocity-driven and force-driven, and input columns of steps that differ from node to node.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <span>
#include <string>
#include <vector>

#include "proto/scene/scene.hpp"
#include "proto/wire/batch.hpp"
#include "proto/wire/columns.hpp"

namespace shearbus::support {

inline v1::Scene velocity_scene(std::uint32_t cells = 24) {
  v1::Scene scene;
  scene.set_name("small_velocity_driven");
  scene.set_strategy(v1::STRATEGY_VELOCITY_DRIVEN);
  scene.mutable_soft()->set_material("aluminium_dlp");
  scene.mutable_hard()->set_material("steel_dlp");
  scene.mutable_layer()->set_thickness_m(20e-6);
  scene.mutable_layer()->set_cells(cells);
  scene.mutable_layer()->set_grading(1.15);
  return scene;
}

inline v1::Scene force_scene(std::uint32_t cells = 24) {
  v1::Scene scene = velocity_scene(cells);
  scene.set_name("small_force_driven");
  scene.set_strategy(v1::STRATEGY_FORCE_DRIVEN);
  scene.mutable_interface()->set_friction_coefficient(0.3);
  scene.mutable_interface()->set_yield_strength_pa(200e6);
  return scene;
}

// The same without cells: the heat is in modes.
inline v1::Scene modes_scene() {
  v1::Scene scene = force_scene();
  scene.mutable_layer()->clear_cells();
  scene.mutable_layer()->clear_grading();
  scene.mutable_layer()->set_heat(v1::HEAT_MODES);
  return scene;
}

inline v1::Scene scene_of(wire::Strategy strategy) {
  return strategy == wire::Strategy::kForceDriven ? force_scene() : velocity_scene();
}

inline wire::Strategy strategy_of(const v1::Scene& scene) {
  return static_cast<wire::Strategy>(scene.strategy());
}

// Returns the scene as TOML, the text that a client sends.
inline std::string text_of(const v1::Scene& scene) {
  return scene::to_toml(scene);
}

inline std::vector<std::uint64_t> node_ids(std::size_t count, std::uint64_t first = 100) {
  std::vector<std::uint64_t> ids(count);
  std::iota(ids.begin(), ids.end(), first);
  return ids;
}

// Returns the value of one input field for node `id` in step number `step`. Nodes differ: some slip slowly, fast or
// backwards, some stick, and some have an open contact in some steps.
inline double input_of(wire::Field field, std::uint64_t id, int step) {
  const double a = static_cast<double>(id % 17) / 17.0;
  switch (field) {
    case wire::Field::kVelocityJump:
      return (id % 5 == 4 ? -1.0 : 1.0) * (0.5 + 150.0 * a);
    case wire::Field::kPressure:
      return (id + static_cast<std::uint64_t>(step)) % 7 == 6 ? -1e8 : 5e9 + 8e9 * a;
    case wire::Field::kStressSoft:
      return 1e8 + 2e8 * a;
    case wire::Field::kStressHard:
      return 2e8 - 1e8 * a;
    case wire::Field::kMassSoft:
      return 0.0135 * (1.0 + a);
    case wire::Field::kMassHard:
      return 0.0395 * (1.0 + a);
    default:
      return 0.0;
  }
}

inline wire::Batch id_column(std::span<const std::uint64_t> ids) {
  wire::Batch batch = wire::Batch::of(std::vector{wire::Field::kNodeId}, ids.size());
  std::ranges::copy(ids, batch.u64(wire::Field::kNodeId).begin());
  return batch;
}

inline wire::Batch id_column(std::initializer_list<std::uint64_t> ids) {
  return id_column(std::span(ids));
}

// Returns the input columns of a step, with one row for each of `ids` in their order. `with_ids` adds the node_id
// column.
inline wire::Batch step_columns(wire::Strategy strategy, std::span<const std::uint64_t> ids, int step,
                                bool with_ids = false) {
  std::vector<wire::Field> fields;
  if (with_ids) fields.push_back(wire::Field::kNodeId);
  const auto required = wire::columns_of(strategy).required;
  for (const wire::Field field : required) fields.push_back(field);
  wire::Batch batch = wire::Batch::of(fields, ids.size());
  for (const wire::Field field : required)
    for (std::size_t row = 0; row < ids.size(); ++row) batch.f64(field)[row] = input_of(field, ids[row], step);
  if (with_ids)
    for (std::size_t row = 0; row < ids.size(); ++row) batch.u64(wire::Field::kNodeId)[row] = ids[row];
  return batch;
}

inline std::vector<std::byte> bytes_of(const wire::Batch& batch) {
  return {batch.bytes().begin(), batch.bytes().end()};
}

}  // namespace shearbus::support
