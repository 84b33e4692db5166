#include "server/physics/solver/melting/phase_change.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include "server/physics/solver/melting/melt_film.hpp"

namespace shearbus::physics {
namespace {

constexpr int kNewtonSteps = 20;  // most Newton steps on the phases before the search that cannot fail

}  // namespace

void add_latent_heat(const Problem& problem, const double* committed, const double* trial,
                     std::array<double, kLanes>& stored) {
  const double per_volume = problem.options.soft.density * problem.options.melt_film->latent_heat;
  for (int lane = 0; lane < kLanes; ++lane)
    stored[static_cast<std::size_t>(lane)] +=
        per_volume * (film_thickness(problem, trial, lane) - film_thickness(problem, committed, lane));
}

double film_thickness(const Problem& problem, const double* tile, int lane) {
  const double* liquid = tile + problem.layout.liquid_fraction + lane;
  const double* weight = problem.heat_grid.weight.data() + problem.heat_grid.interface;
  double thickness = 0.0;
  for (std::size_t i = 0; i < problem.layout.num_vertices; ++i) thickness += weight[i] * liquid[i * kLanes];
  return thickness;
}

void PhaseChange::begin(const Problem& problem, const HeatOperator& heat, const Material& soft, const double* committed,
                        int lane) {
  heat_ = &heat;
  layout_ = &problem.layout;
  lane_ = lane;
  work_ = 0.0;
  solves_ = 0;
  const double* all = committed + problem.layout.first_temperature() + lane;
  const double* T = committed + problem.layout.temperature + lane;
  const double* liquid = committed + problem.layout.liquid_fraction + lane;
  far_ = std::min(all[0], T[(problem.layout.num_vertices - 1) * kLanes]);
  T_melt_ = soft.melting_temperature;
  melt_ = T_melt_ - far_;
  slack_ = 16.0 * std::numeric_limits<double>::epsilon() * T_melt_;
  read(problem, heat, soft, T, liquid);
  release(problem, heat, liquid);
  eliminate(heat, all);
  solve();
}

// Coefficients, enthalpy and phase of each vertex before the step. HeatOperator has divided the coefficients of its
// equations by its pivots.
void PhaseChange::read(const Problem& problem, const HeatOperator& heat, const Material& soft, const double* T,
                       const double* liquid) {
  const MeltFilmOptions& film = *problem.options.melt_film;
  const std::size_t first = static_cast<std::size_t>(heat.interface);
  const double rise = latent_rise(film, soft);
  vertex_.resize(problem.layout.num_vertices);
  last_ = 0;
  for (std::size_t i = 0; i < vertex_.size(); ++i) {
    Vertex& v = vertex_[i];
    const double inverse_pivot = heat.inverse_pivot[first + i];
    const double t = T[i * kLanes] - far_, f = liquid[i * kLanes];
    v.before = i == 0 ? 0.0 : heat.outward[first + i] / inverse_pivot;
    v.behind = heat.inward[first + i] / inverse_pivot;
    v.latent = i == 0 ? rise * problem.soft_share_at_interface() : rise;
    v.heat = t + v.latent * f;
    v.source = 0.0;
    const double weight = problem.heat_grid.weight[first + i];
    v.fluidity = weight * (f > 0.0 || t > melt_ ? fluidity(film, soft, T[i * kLanes]) : 1.0 / film.viscosity);
    v.phase = f >= 1.0 ? Phase::kLiquid : f > 0.0 || t > melt_ ? Phase::kMelting : Phase::kSolid;
    if (v.phase != Phase::kSolid) last_ = static_cast<int>(i);
  }
}

// Where the work becomes heat: in the liquid as it was sheared by the stress before the step, or without liquid at
// z = 0.
void PhaseChange::release(const Problem& problem, const HeatOperator& heat, const double* liquid) {
  const Material& soft = problem.options.soft;
  const Material& hard = problem.options.hard;
  double sheared = 0.0;
  for (int i = 0; i <= last_; ++i)
    sheared += vertex_[static_cast<std::size_t>(i)].fluidity * liquid[std::ptrdiff_t{i} * kLanes];
  const auto rise = [&](int i) { return heat.dt / problem.heat_grid.capacity(heat.interface + i, soft, hard); };
  if (sheared <= 0.0) {
    vertex_.front().source = rise(0);
    return;
  }
  for (int i = 0; i <= last_; ++i) {
    Vertex& v = vertex_[static_cast<std::size_t>(i)];
    v.source = v.fluidity * liquid[std::ptrdiff_t{i} * kLanes] / sheared * rise(i);
  }
}

// Eliminates both bodies towards z = 0, as if all vertices were solid.
void PhaseChange::eliminate(const HeatOperator& heat, const double* hard) {
  double outer = 0.0, kept = 0.0;
  for (std::size_t i = vertex_.size(); i-- > 1;) {
    Vertex& v = vertex_[i];
    const double own = 1.0 + v.behind * kept;
    const double pivot = own + v.before;
    v.solid = outer = (v.heat + v.behind * outer) / pivot;
    v.carried = v.before / pivot;
    v.kept = kept = own / pivot;
  }
  const std::size_t first = static_cast<std::size_t>(heat.interface);
  hard_.resize(first);
  outer = kept = 0.0;
  for (std::size_t i = 0; i < first; ++i) {
    const double inverse_pivot = heat.inverse_pivot[i];
    const double own = 1.0 + heat.inward[i] / inverse_pivot * kept;
    hard_[i] = outer = (hard[i * kLanes] - far_) * inverse_pivot + heat.inward[i] * outer;
    kept = own / (own + heat.outward[i] / inverse_pivot);
  }
  hard_kept_ = kept;
  before_hard_ = first == 0 ? 0.0 : heat.inward_hard / heat.inverse_pivot[first];
}

// Solves the linear system of the phases at hand, for all q at once: eliminates from the last coupled vertex to z = 0
// and substitutes back.
void PhaseChange::solve() {
  const std::size_t end = static_cast<std::size_t>(last_) + 1;
  work_ += static_cast<double>(end);
  ++solves_;
  const bool solid_behind = end < vertex_.size();
  double t = solid_behind ? vertex_[end].solid : 0.0, per_flux = 0.0;
  double kept = solid_behind ? vertex_[end].kept : 0.0;
  for (std::size_t i = end; i-- > 0;) {
    Vertex& v = vertex_[i];
    v.f = v.phase == Phase::kLiquid ? 1.0 : 0.0;
    v.f_per_flux = 0.0;
    if (v.phase == Phase::kMelting) {
      v.t = t = melt_;
      v.t_per_flux = per_flux = 0.0;
      v.carried = 0.0;
      kept = 1.0;
      continue;
    }
    double own = 1.0 + v.behind * kept;
    double heat = v.heat - v.latent * v.f + v.behind * t;
    if (i == 0 && !hard_.empty()) {
      own += before_hard_ * hard_kept_;
      heat += before_hard_ * hard_.back();
    }
    const double pivot = own + v.before;
    v.t = t = heat / pivot;
    v.t_per_flux = per_flux = (v.source + v.behind * per_flux) / pivot;
    v.carried = v.before / pivot;
    kept = own / pivot;
  }
  for (std::size_t i = 1; i < end; ++i) {
    vertex_[i].t += vertex_[i].carried * vertex_[i - 1].t;
    vertex_[i].t_per_flux += vertex_[i].carried * vertex_[i - 1].t_per_flux;
  }
  melt_partly();
}

// Liquid fractions of the melting vertices: what is left of their heat when they are at T_melt. Sums the compliance.
void PhaseChange::melt_partly() {
  compliance_ = compliance_per_flux_ = 0.0;
  const std::size_t end = static_cast<std::size_t>(last_) + 1;
  for (std::size_t i = 0; i < end; ++i) {
    Vertex& v = vertex_[i];
    if (v.phase == Phase::kMelting) {
      double heat = v.heat - melt_, per_flux = v.source;
      if (i > 0) {
        heat -= v.before * (melt_ - vertex_[i - 1].t);
        per_flux += v.before * vertex_[i - 1].t_per_flux;
      } else if (!hard_.empty()) {
        heat -= before_hard_ * (melt_ * hard_kept_ - hard_.back());
      }
      if (i + 1 < end) {
        heat -= v.behind * (melt_ - vertex_[i + 1].t);
        per_flux += v.behind * vertex_[i + 1].t_per_flux;
      } else if (end < vertex_.size()) {
        heat -= v.behind * (melt_ * vertex_[end].kept - vertex_[end].solid);
      }
      v.f = heat / v.latent;
      v.f_per_flux = per_flux / v.latent;
    }
    compliance_ += v.fluidity * v.f;
    compliance_per_flux_ += v.fluidity * v.f_per_flux;
  }
}

PhaseChange::Response PhaseChange::at(double q) const {
  const Vertex& v = vertex_.front();
  const double T0 = v.phase == Phase::kMelting ? T_melt_ : far_ + temperature(v, q);
  return {T0, std::max(0.0, compliance_ + q * compliance_per_flux_)};
}

// Lets the vertices behind the last coupled one melt that would be hotter than T_melt. Heat only comes from the front,
// so these are the first ones.
bool PhaseChange::extend(double q) {
  const int before = last_;
  double t = temperature(vertex_[static_cast<std::size_t>(last_)], q);
  for (std::size_t i = static_cast<std::size_t>(last_) + 1; i < vertex_.size(); ++i) {
    t = vertex_[i].solid + vertex_[i].carried * t;
    if (!(t > melt_ + slack_)) break;
    vertex_[i].phase = Phase::kMelting;
    last_ = static_cast<int>(i);
  }
  return last_ != before;
}

// Vertices that extend() adds have no solution yet: they keep the phase that it gave them until the next one.
bool PhaseChange::change_phases(double q, bool of_liquid) {
  const int solved = last_;
  bool changed = extend(q);
  for (int i = 0; i <= solved; ++i) {
    Vertex& v = vertex_[static_cast<std::size_t>(i)];
    const Phase old = v.phase;
    if (old == Phase::kMelting) {
      const double heat = v.latent * fraction(v, q);
      if (heat < -slack_) v.phase = Phase::kSolid;
      if (of_liquid && heat > v.latent + slack_) v.phase = Phase::kLiquid;
    } else if (old == Phase::kSolid ? temperature(v, q) > melt_ + slack_
                                    : of_liquid && temperature(v, q) < melt_ - slack_) {
      v.phase = Phase::kMelting;
    }
    changed = changed || v.phase != old;
  }
  return changed;
}

bool PhaseChange::revise(double q) {
  const bool changed = change_phases(q, true);
  if (changed) solve();
  return changed;
}

void PhaseChange::settle(double q) {
  for (int step = 0; step < kNewtonSteps; ++step)
    if (!revise(q)) return;
  // The search that cannot fail. Without liquid vertices, whose excess of heat stays in melting ones, all temperatures
  // are too low. Each vertex whose liquid fraction exceeds 1 becomes liquid, which warms the others: no vertex ever has
  // to become solid again. For given liquid vertices temperatures only fall from the second change of the other phases
  // on (policy iteration with an M-matrix), so that these end.
  for (Vertex& v : vertex_)
    if (v.phase == Phase::kLiquid) v.phase = Phase::kMelting;
  for (std::size_t sweep = 0; sweep <= vertex_.size(); ++sweep) {
    solve();
    for (std::size_t inner = 0; inner <= 2 * vertex_.size() && change_phases(q, false); ++inner) solve();
    bool grown = false;
    for (int i = 0; i <= last_; ++i) {
      Vertex& v = vertex_[static_cast<std::size_t>(i)];
      if (v.phase != Phase::kMelting || !(v.latent * fraction(v, q) > v.latent + slack_)) continue;
      v.phase = Phase::kLiquid;
      grown = true;
    }
    if (!grown) return;
  }
}

void PhaseChange::finish(double q, double* trial) const {
  double* T = trial + layout_->temperature + lane_;
  double* liquid = trial + layout_->liquid_fraction + lane_;
  double t = 0.0;
  for (std::size_t i = 0; i < vertex_.size(); ++i) {
    const Vertex& v = vertex_[i];
    const bool coupled = i <= static_cast<std::size_t>(last_);
    t = coupled ? temperature(v, q) : v.solid + v.carried * t;
    double at = far_ + t, f = 0.0;
    if (coupled && v.phase == Phase::kMelting) {
      at = T_melt_;
      f = std::clamp(fraction(v, q), 0.0, 1.0);
    } else if (coupled && v.phase == Phase::kLiquid) {
      at = std::max(at, T_melt_);
      f = 1.0;
    } else {
      at = std::min(at, T_melt_);
    }
    T[i * kLanes] = at;
    liquid[i * kLanes] = f;
  }
  double* hard = trial + layout_->first_temperature() + lane_;
  t = temperature(vertex_.front(), q);
  for (std::size_t i = hard_.size(); i-- > 0;) {
    t = hard_[i] + heat_->outward[i] * t;
    hard[i * kLanes] = far_ + t;
  }
}

}  // namespace shearbus::physics
