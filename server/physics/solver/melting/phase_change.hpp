// Heat conduction with melting and freezing, for one step of one node, in enthalpy form (METHODS.md, "Melt film"). With
// t = T - T_far, the liquid fraction f of each vertex of the soft body and the latent heat as a rise of temperature,
//
//   (1 + a + c) t_i - a t_(i-1) - c t_(i+1) + latent_i f_i = t_old_i + latent_i f_old_i + q source_i,
//   f_i = 0 where t_i < t_melt,   0 <= f_i <= 1 where t_i = t_melt,   f_i = 1 where t_i > t_melt,
//
// with a and c of HeatOperator. The hard body and the solid behind the melt are eliminated towards the vertices between
// them. The system has one solution for each q, and T and f never fall where q rises. For given phases of the vertices
// (solid, melting, liquid) it is linear, so T and f are affine functions of q.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "server/physics/solver/problem.hpp"

namespace shearbus::physics {

// Thickness of the melt of one lane: the liquid of all its vertices  [m].
double film_thickness(const Problem& problem, const double* tile, int lane);

// Adds the growth of the latent heat of the soft body over a step, [lane]  [J/m2].
void add_latent_heat(const Problem& problem, const double* committed, const double* trial,
                     std::array<double, kLanes>& stored);

class PhaseChange {
 public:
  // Begins the step of one lane from the tile `committed`, with the phases before the step. `soft`: the material at the
  // lane's pressure.
  void begin(const Problem& problem, const HeatOperator& heat, const Material& soft, const double* committed, int lane);

  // What the interface feels of the heat flux q: its temperature, and the compliance of the film, the integral of
  // dz/eta over the liquid, which is the slip velocity per stress.
  struct Response {
    double T0;          // [K]
    double compliance;  // [m/(Pa s)]
  };
  // The response to q  [W/m2] with the phases at hand.
  Response at(double q) const;

  // Changes the phases that the flux q contradicts, by one Newton step. Returns whether there were any.
  bool revise(double q);
  // Finds the phases under the flux q. Cannot fail.
  void settle(double q);

  // Writes temperatures and liquid fractions under the flux q, of which settle() or revise() has found the phases.
  void finish(double q, double* trial) const;

  double work() const { return work_; }   // vertices in all linear systems solved so far
  int solves() const { return solves_; }  // number of these systems

 private:
  enum class Phase : std::uint8_t { kSolid, kMelting, kLiquid };
  struct Vertex {
    double before, behind;        // coefficients a and c
    double heat;                  // t_old + latent f_old  [K]
    double source;                // rise of t by the part of q = 1 W/m2 that is released at this vertex  [K m2/W]
    double latent;                // [K]
    double fluidity;              // weight/eta: the compliance of a vertex that is all liquid  [m/(Pa s)]
    double solid, carried, kept;  // all solid from here on: t = solid + carried t_(i-1), kept = 1 - carried
    double t, t_per_flux;         // t = t + q t_per_flux  [K]
    double f, f_per_flux;         // f = f + q f_per_flux
    Phase phase;
  };

  void read(const Problem& problem, const HeatOperator& heat, const Material& soft, const double* T,
            const double* liquid);
  void release(const Problem& problem, const HeatOperator& heat, const double* liquid);
  void eliminate(const HeatOperator& heat, const double* hard);
  void solve();
  void melt_partly();
  bool extend(double q);
  // Changes the phases that the flux q contradicts, those of liquid vertices and to liquid only if `of_liquid`, without
  // a new solution. Returns whether there were any.
  bool change_phases(double q, bool of_liquid);
  double temperature(const Vertex& vertex, double q) const { return vertex.t + q * vertex.t_per_flux; }
  double fraction(const Vertex& vertex, double q) const { return vertex.f + q * vertex.f_per_flux; }

  std::vector<Vertex> vertex_;  // of the soft body, from z = 0 on
  std::vector<double> hard_;    // t of the hard body's vertices, outermost first, if t of their inner neighbour is 0
  const HeatOperator* heat_ = nullptr;
  const TileLayout* layout_ = nullptr;
  double before_hard_ = 0.0;  // coefficient of z = 0 for its neighbour in the hard body
  double hard_kept_ = 1.0;    // 1 - dt/dt0 of this neighbour
  double far_ = 0.0;          // T_far  [K]
  double T_melt_ = 0.0;       // [K]
  double melt_ = 0.0;         // T_melt - T_far  [K]
  double slack_ = 0.0;        // rounding of a temperature, by which a phase need not be changed  [K]
  double compliance_ = 0.0, compliance_per_flux_ = 0.0;
  double work_ = 0.0;
  int solves_ = 0;
  int lane_ = 0;
  int last_ = 0;  // outermost vertex that may be other than solid
};

}  // namespace shearbus::physics
