#include "client/study/map/sweep.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "proto/wire/status.hpp"
#include "server/embedded.hpp"

namespace shearbus::map {
namespace {

// Throws unless the session is velocity-driven with drive "layer_shear". A session with drive "interface_slip" is
// recognized by its optional column for the shear rate.
void require_imposed_shear(const wire::SessionOpened& opened) {
  if (opened.strategy == wire::Strategy::kVelocityDriven &&
      std::ranges::find(opened.optional_columns, Field::kSoftShearRate) == opened.optional_columns.end())
    return;
  throw Error({.code = Code::kInvalidScene,
               .text = "a map needs strategy = \"velocity_driven\" with drive = \"layer_shear\": it compares the slip "
                       "that the layer carries with the slip that is imposed on it",
               .field = "strategy"});
}

Observation observed(const StepResult& result, double time_s, const std::vector<double>& slip) {
  const auto copy = [](const auto& column) { return std::vector(column.begin(), column.end()); };
  return {.time_s = time_s,
          .shear_stress_pa = copy(result.shear_stress_pa()),
          .slip_m = slip,
          .interface_temperature_k = copy(result.interface_temperature_k()),
          .regime = copy(result.regime())};
}

}  // namespace

std::vector<double> log_spaced(double low, double high, std::size_t count) {
  std::vector<double> values(count, low);
  for (std::size_t i = 1; i + 1 < count; ++i)
    values[i] = low * std::pow(high / low, static_cast<double>(i) / static_cast<double>(count - 1));
  if (count > 1) values.back() = high;
  return values;
}

Map sweep(const SceneText& scene, const Axes& axes, const std::vector<double>& times_s, double dt_s) {
  std::vector<std::uint64_t> nodes(axes.num_nodes());
  std::iota(nodes.begin(), nodes.end(), 0);
  const server::Embedded server;
  Client client({.endpoint = server.endpoint(), .context = server.context(), .name = "shearbus-study"});
  Session session = client.open(scene.text, scene.file, nodes);
  require_imposed_shear(session.opened());

  Map map{.axes = axes,
          .dt_s = dt_s,
          .melting_time_s = std::vector(nodes.size(), std::numeric_limits<double>::quiet_NaN()),
          .scene_name = session.opened().scene_name,
          .effective_scene = session.effective_scene(),
          .server_version = client.welcome().server_version,
          .warnings = session.warnings()};
  Batch request = session.request();
  for (std::size_t p = 0; p < axes.pressure_pa.size(); ++p) {
    for (std::size_t v = 0; v < axes.velocity_m_per_s.size(); ++v) {
      request.f64(Field::kPressure)[axes.node(p, v)] = axes.pressure_pa[p];
      request.f64(Field::kVelocityJump)[axes.node(p, v)] = axes.velocity_m_per_s[v];
    }
  }
  std::vector<double> slip(nodes.size(), 0.0);
  std::uint64_t step = 0;
  for (const double time_s : times_s) {
    const auto last = static_cast<std::uint64_t>(std::llround(time_s / dt_s));
    for (; step < last; ++step) {
      const double now = static_cast<double>(step + 1) * dt_s;
      const StepResult& result = session.advance(request, {.dt_s = dt_s, .time_s = now, .step = step});
      for (std::size_t i = 0; i < slip.size(); ++i) {
        slip[i] += result.sliding_velocity_m_per_s()[i] * dt_s;
        const bool melts = result.regime()[i] == static_cast<std::uint8_t>(wire::Regime::kMelting);
        if (melts && std::isnan(map.melting_time_s[i])) map.melting_time_s[i] = now;
      }
      if (step + 1 == last) map.observations.push_back(observed(result, time_s, slip));
    }
  }
  session.close();
  return map;
}

}  // namespace shearbus::map
