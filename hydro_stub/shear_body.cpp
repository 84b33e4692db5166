#include "hydro_stub/shear_body.hpp"

#include <cmath>

namespace shearbus::hydro {
namespace {

// Advances the outer node of a free end, which has the mass of half a zone and no stress on its outer side.
void accelerate_free_end(ShearBody& body, double dt) {
  const double scale = dt / body.mesh.last_half_zone_mass();
  double* end = body.velocity_at(body.mesh.zones);
  const double* inner = body.stress_at(body.mesh.zones - 1);
  for (std::size_t i = 0; i < body.mesh.columns; ++i) end[i] -= scale * inner[i];
}

// Advances the outer node of a transmitting end, which stands for an infinite body behind it. In an outgoing wave the
// stress is
//     tau = -Z (V - V_far)
// where Z is the impedance and V_far the velocity of the undisturbed body. The relation is evaluated at the middle of
// the step, the time level of the stress. With dt equal to the transit time of a zone every wave passes unchanged. With
// a smaller Courant number C a wave of frequency w and wave number k is reflected, in a mesh of zone width dz, by
//     (cos(k dz/2) - cos(w dt/2)) / (cos(k dz/2) + cos(w dt/2)),   sin(w dt/2) = C sin(k dz/2),
// that is, by about (w dt)^2 (1 - 1/C^2) / 16.
void accelerate_transmitting_end(ShearBody& body, double dt) {
  const double mass = body.mesh.last_half_zone_mass();
  const double impedance = body.mesh.impedance();
  const double inverse = 1.0 / (mass / dt + 0.5 * impedance);
  double* end = body.velocity_at(body.mesh.zones);
  const double* inner = body.stress_at(body.mesh.zones - 1);
  for (std::size_t i = 0; i < body.mesh.columns; ++i) {
    const double old = end[i] - body.far_velocity[i];
    const double next = ((mass / dt - 0.5 * impedance) * old - inner[i]) * inverse;
    const double middle = 0.5 * (old + next);
    const double traction = -impedance * middle;
    end[i] = body.far_velocity[i] + next;
    body.far_impulse[i] += traction * dt;
    body.far_work[i] += traction * (body.far_velocity[i] + middle) * dt;
  }
}

}  // namespace

double BodyMesh::wave_speed() const {
  return std::sqrt(shear_modulus / density);
}
double BodyMesh::last_half_zone_mass() const {
  return 0.5 * density * width(zones - 1);
}
double BodyMesh::impedance() const {
  return std::sqrt(shear_modulus * density);
}

ShearBody::ShearBody(const BodyMesh& body_mesh, std::span<const double> velocity_of_columns)
    : mesh(body_mesh),
      velocity((body_mesh.zones + 1) * body_mesh.columns),
      stress(body_mesh.zones * body_mesh.columns, 0.0),
      far_velocity(velocity_of_columns.begin(), velocity_of_columns.end()),
      far_impulse(body_mesh.columns, 0.0),
      far_work(body_mesh.columns, 0.0) {
  for (std::size_t j = 0; j <= mesh.zones; ++j) {
    for (std::size_t i = 0; i < mesh.columns; ++i) velocity_at(j)[i] = velocity_of_columns[i];
  }
}

void accelerate(ShearBody& body, double dt) {
  const std::size_t columns = body.mesh.columns;
  for (std::size_t j = 1; j < body.mesh.zones; ++j) {
    const double scale = dt / (body.mesh.density * (0.5 * (body.mesh.width(j - 1) + body.mesh.width(j))));
    double* velocity = body.velocity_at(j);
    const double* inner = body.stress_at(j - 1);
    const double* outer = body.stress_at(j);
    for (std::size_t i = 0; i < columns; ++i) velocity[i] += scale * (outer[i] - inner[i]);
  }
  if (body.mesh.far_end == guest::FAR_END_FREE) {
    accelerate_free_end(body, dt);
  } else {
    accelerate_transmitting_end(body, dt);
  }
}

void accelerate_interface(ShearBody& body, double dt, std::span<const double> traction) {
  const double scale = dt / body.mesh.half_zone_mass();
  double* velocity = body.velocity_at(0);
  const double* outer = body.stress_at(0);
  for (std::size_t i = 0; i < body.mesh.columns; ++i) velocity[i] += scale * (outer[i] - traction[i]);
}

void strain(ShearBody& body, double dt) {
  const std::size_t columns = body.mesh.columns;
  for (std::size_t j = 0; j < body.mesh.zones; ++j) {
    const double scale = dt * body.mesh.shear_modulus / body.mesh.width(j);
    double* stress = body.stress_at(j);
    const double* inner = body.velocity_at(j);
    const double* outer = body.velocity_at(j + 1);
    for (std::size_t i = 0; i < columns; ++i) stress[i] += scale * (outer[i] - inner[i]);
  }
}

std::optional<BodyPlace> place_at(const BodyMesh& mesh, double distance) {
  double begin = 0.0;
  for (std::size_t j = 0; j < mesh.zones; ++j) {
    const double end = begin + mesh.width(j);
    if (distance <= end) return BodyPlace{.node = j, .weight = (distance - begin) / mesh.width(j)};
    begin = end;
  }
  return std::nullopt;
}

double velocity_at(const ShearBody& body, const BodyPlace& place, std::size_t column) {
  const double inner = body.velocity_at(place.node)[column];
  return inner + place.weight * (body.velocity_at(place.node + 1)[column] - inner);
}

double momentum(const ShearBody& body, std::size_t column) {
  if (!body.mesh.widths.empty()) {
    double sum = 0.0;
    for (std::size_t j = 0; j < body.mesh.zones; ++j)
      sum += 0.5 * body.mesh.width(j) * (body.velocity_at(j)[column] + body.velocity_at(j + 1)[column]);
    return body.mesh.density * sum;
  }
  double sum = 0.0;
  for (std::size_t j = 1; j < body.mesh.zones; ++j) sum += body.velocity_at(j)[column];
  sum += 0.5 * (body.velocity_at(0)[column] + body.velocity_at(body.mesh.zones)[column]);
  return body.mesh.density * body.mesh.zone_width * sum;
}

double energy(const ShearBody& body, std::size_t column, double dt) {
  double kinetic = 0.0;
  double elastic = 0.0;
  for (std::size_t j = 0; j < body.mesh.zones; ++j) {
    const double inner = body.velocity_at(j)[column];
    const double outer = body.velocity_at(j + 1)[column];
    const double stress = body.stress_at(j)[column];
    const double stress_old = stress - dt * body.mesh.shear_modulus / body.mesh.width(j) * (outer - inner);
    kinetic += 0.25 * body.mesh.width(j) * (inner * inner + outer * outer);
    elastic += 0.5 * body.mesh.width(j) * stress * stress_old;
  }
  return body.mesh.density * kinetic + elastic / body.mesh.shear_modulus;
}

}  // namespace shearbus::hydro
