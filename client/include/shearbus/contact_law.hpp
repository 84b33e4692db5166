// A friction law for contact codes that ask a law for the traction of one node at a time, over client.hpp (C++17). It
// takes vectors of the code's own frame, nodal forces and masses, and answers vectors; one request serves all nodes.
//
//   shearbus::ContactLaw law(options, node_ids, 3);        // dimensions of the vectors: 2 (in the plane x, y) or 3
//   every step, once the forces are known and before the velocities move:
//     for each touching node:  law.touch(id, {normal, jump, pressure, area, force_soft, force_hard, m_soft, m_hard});
//     law.solve(dt, time, step);
//     for each touching node:  force_soft += area * law.traction(id);  force_hard -= area * law.traction(id);
//
// Nodes that are not touched in a step are open in it and cool; their traction is zero. A node that is touched for the
// first time is registered with the scene's initial temperature. Faults throw shearbus::Error; after one of solve() the
// same solve() is the same request, and touch() begins another step. What client.hpp says of threads and units holds.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "shearbus/client.hpp"

namespace shearbus {
inline namespace v1 {

using Vector = std::array<double, 3>;  // in two dimensions the third value is not read

// What a code knows of a touching node before friction acts. The far-field form of a request follows from it, with
// its signs and areas.
struct Contact {
  Vector normal{};      // of length 1, from the hard body to the soft one
  Vector jump{};        // velocity of the soft side minus that of the hard one  [m/s]
  double pressure = 0;  // positive in compression  [Pa]
  double area = 0;      // that the node stands for  [m2]
  Vector force_soft{};  // on the soft node and on the hard one, without friction  [N]
  Vector force_hard{};
  double mass_soft = 0;  // of these nodes  [kg]
  double mass_hard = 0;
};

// The same for codes that know only the traction that would stop the slip: the stick form.
struct StickContact {
  Vector normal{};
  Vector jump{};
  double pressure = 0;
  Vector stick_traction{};  // impedance times the jump that the step would have without friction  [Pa]
  double impedance = 0;     // 1 / (dt (1/mass_soft + 1/mass_hard)), masses per area  [Pa s/m]
};

class ContactLaw {
 public:
  ContactLaw(const Options& options, const Ids& node_ids, int dimensions)
      : ContactLaw(Session(options, node_ids), dimensions) {}
  // With a session that was opened or resumed otherwise. The scene has tangential_components = dimensions - 1.
  ContactLaw(Session session, int dimensions) : session_(std::move(session)) {
    const std::uint32_t components = session_.info().tangential_components;
    if (dimensions < 2 || dimensions > 3 || components != static_cast<std::uint32_t>(dimensions - 1))
      throw Error::of(SHEARBUS_SHAPE, "tangential_components",
                      "the law has " + std::to_string(dimensions) +
                          " dimensions, and the scene has tangential_components = " + std::to_string(components) +
                          "; expected one component in two dimensions, and two in three");
    components_ = components;
    for (const std::uint64_t id : session_.node_ids()) nodes_.emplace(id, Node{});
  }

  void touch(std::uint64_t id, const Contact& at) {
    if (!(at.area > 0) || !(at.mass_soft > 0) || !(at.mass_hard > 0))
      throw Error::of(SHEARBUS_INVALID_VALUE, "area",
                      "node " + std::to_string(id) + ": area and masses must be above 0");
    const Node& node = add(id, at.normal, false);
    const std::size_t row = node.row;
    const double per_area = 1.0 / at.area;
    fill(node, kJump, at.jump, 1.0);
    fill(node, kFirst, at.force_soft, per_area);
    fill(node, kSecond, at.force_hard, -per_area);
    scalars_[kPressure][row] = at.pressure;
    scalars_[kMassSoft][row] = at.mass_soft * per_area;
    scalars_[kMassHard][row] = at.mass_hard * per_area;
  }
  void touch(std::uint64_t id, const StickContact& at) {
    const Node& node = add(id, at.normal, true);
    const std::size_t row = node.row;
    fill(node, kJump, at.jump, 1.0);
    fill(node, kFirst, at.stick_traction, 1.0);
    scalars_[kPressure][row] = at.pressure;
    scalars_[kMassSoft][row] = at.impedance;
  }

  // Steps all nodes of the session, those that were touched since the last solve() in contact.
  shearbus_result solve(double dt_s, double time_s = 0.0, std::uint64_t step_number = 0) {
    if (solved_) begin();  // no node was touched
    asked_ = true;
    register_new();
    make_room();
    ids_.reserve(1);  // a column without rows has an address, too
    Step step(ids_);
    columns(step);
    step.open_absent(true).dt(dt_s).time(time_s).number(step_number);
    const shearbus_result result = session_.step(step);
    solved_ = true;
    return result;
  }

  // Of the last solve(): the traction on the soft side, to be applied to it times the area, and against it to the hard
  // side [Pa]; zero for a node that was not touched.
  Vector traction(std::uint64_t id) const {
    Vector traction{};
    const Node* node = touched(id);
    if (node == nullptr) return traction;
    for (std::size_t c = 0; c < components_; ++c)
      for (std::size_t i = 0; i < 3; ++i) traction[i] -= stress_[c][node->row] * node->tangent[c][i];
    return traction;
  }
  bool touches(std::uint64_t id) const { return touched(id) != nullptr; }
  double temperature(std::uint64_t id) const { return temperature_[row_of(id)]; }  // of the interface [K]
  std::uint8_t outcome(std::uint64_t id) const { return outcome_[row_of(id)]; }    // bits SHEARBUS_OUTCOME_
  std::uint8_t regime(std::uint64_t id) const { return regime_[row_of(id)]; }      // a SHEARBUS_REGIME_

  // Has every solve() ask for another column with one double a node, such as SHEARBUS_HEAT_TO_SOFT, for value().
  void want(std::uint32_t column) { wanted_.emplace_back(column, Column(outcome_.size())); }
  double value(std::uint32_t column, std::uint64_t id) const {
    for (const auto& [wanted, values] : wanted_)
      if (wanted == column) return values[row_of(id)];
    throw Error::of(SHEARBUS_UNSUPPORTED, "column", "want() the column " + std::to_string(column) + " before solve()");
  }

  Session& session() { return session_; }  // for trials of other steps, marks, tickets, the host's own law, closing

 private:
  enum { kJump, kFirst, kSecond, kVectors };           // the stress of the soft side or the stick stress; the hard one
  enum { kPressure, kMassSoft, kMassHard, kScalars };  // the mass of the soft side or the impedance; the hard one
  struct Node {
    std::uint64_t step = 0;  // in which it was touched last
    std::size_t row = 0;
    std::array<Vector, 2> tangent{};
  };
  using Column = std::vector<double>;

  static double dot(const Vector& a, const Vector& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
  static Vector cross(const Vector& a, const Vector& b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
  }

  // The first touch of a step forgets the rows of the one before, answered or not, and nodes that were refused.
  void begin() {
    if (!asked_) return;
    asked_ = solved_ = false;
    if (refused_) {
      for (const std::uint64_t id : new_) nodes_.erase(id);
      new_.clear();
      refused_ = false;
    }
    ++step_;
    ids_.clear();
  }

  // Columns for one row more than there are.
  void make_room() {
    if (ids_.size() < outcome_.size()) return;
    const std::size_t rows = ids_.size() + ids_.size() / 2 + 1;
    for (auto& vector : vectors_)
      for (Column& column : vector) column.resize(rows);
    for (Column& column : scalars_) column.resize(rows);
    for (Column& column : stress_) column.resize(rows);
    temperature_.resize(rows);
    outcome_.resize(rows);
    regime_.resize(rows);
    for (auto& [column, values] : wanted_) values.resize(rows);
  }

  // Adds a row for the node. The result stays valid.
  const Node& add(std::uint64_t id, const Vector& normal, bool sticks) {
    begin();
    if (!ids_.empty() && sticks != sticks_)
      throw Error::of(SHEARBUS_SHAPE, "impedance",
                      "node " + std::to_string(id) +
                          ": the nodes of a step are given all in far-field form, or all "
                          "in stick form");
    const double square = components_ == 1 ? normal[0] * normal[0] + normal[1] * normal[1] : dot(normal, normal);
    if (!(std::fabs(square - 1.0) < 2e-6))
      throw Error::of(SHEARBUS_INVALID_VALUE, "normal",
                      "node " + std::to_string(id) + ": the normal has the length " +
                          std::to_string(std::sqrt(square)) + ", expected 1");
    const auto found = nodes_.find(id);
    if (found != nodes_.end() && found->second.step == step_)
      throw Error::of(SHEARBUS_DUPLICATE_NODE, "node_id",
                      "node " + std::to_string(id) + " is touched twice in a step: give each contact an id of its own");
    make_room();
    if (found == nodes_.end()) new_.push_back(id);
    Node& node = found != nodes_.end() ? found->second : nodes_[id];
    sticks_ = sticks;
    node.step = step_;
    node.row = ids_.size();
    turn(node, normal);
    ids_.push_back(id);
    return node;
  }

  // The tangents of a node follow its normal: each is the former one, without what it has of the new normal.
  void turn(Node& node, const Vector& normal) const {
    if (components_ == 1) {
      node.tangent[0] = {normal[1], -normal[0], 0.0};
      return;
    }
    Vector first = node.tangent[0];
    if (!(dot(first, first) > 0.0)) first[least(normal)] = 1.0;
    double along = dot(first, normal);
    if (1.0 - along * along < 1e-3) {  // a normal that has turned by a right angle at once
      first = {};
      first[least(normal)] = 1.0;
      along = dot(first, normal);
    }
    for (std::size_t i = 0; i < 3; ++i) first[i] -= along * normal[i];
    const double length = std::sqrt(dot(first, first));
    for (double& value : first) value /= length;
    node.tangent = {first, cross(normal, first)};
  }
  static std::size_t least(const Vector& normal) {
    std::size_t least = 0;
    for (std::size_t i = 1; i < 3; ++i)
      if (std::fabs(normal[i]) < std::fabs(normal[least])) least = i;
    return least;
  }

  void fill(const Node& node, std::size_t column, const Vector& value, double factor) {
    const Vector& first = node.tangent[0];
    const double in_plane = value[0] * first[0] + value[1] * first[1];
    if (components_ == 1) {
      vectors_[column][0][node.row] = factor * in_plane;
      return;
    }
    vectors_[column][0][node.row] = factor * (in_plane + value[2] * first[2]);
    vectors_[column][1][node.row] = factor * dot(value, node.tangent[1]);
  }

  void register_new() {
    if (new_.empty()) return;
    try {
      session_.register_nodes(new_);
    } catch (const Error& fault) {
      refused_ = fault.code() != SHEARBUS_UNKNOWN_OUTCOME && fault.code() != SHEARBUS_UNREACHABLE;
      throw;
    }
    refused_ = false;
    new_.clear();
  }

  void columns(Step& step) {
    const auto in = [&](std::uint32_t field, const Column& column, std::uint32_t component = 0) {
      step.in_strided(field, column.data(), 0, component);
    };
    for (std::uint32_t c = 0; c < components_; ++c) {
      in(SHEARBUS_VELOCITY_JUMP, vectors_[kJump][c], c);
      in(sticks_ ? SHEARBUS_STICK_STRESS : SHEARBUS_STRESS_SOFT, vectors_[kFirst][c], c);
      if (!sticks_) in(SHEARBUS_STRESS_HARD, vectors_[kSecond][c], c);
      step.out_strided(SHEARBUS_SHEAR_STRESS, stress_[c].data(), 0, c);
    }
    in(SHEARBUS_PRESSURE, scalars_[kPressure]);
    in(sticks_ ? SHEARBUS_IMPEDANCE : SHEARBUS_MASS_SOFT, scalars_[kMassSoft]);
    if (!sticks_) in(SHEARBUS_MASS_HARD, scalars_[kMassHard]);
    step.out_strided(SHEARBUS_INTERFACE_TEMPERATURE, temperature_.data(), 0);
    step.out_strided(SHEARBUS_OUTCOME, outcome_.data(), 0);
    step.out_strided(SHEARBUS_REGIME, regime_.data(), 0);
    for (auto& [column, values] : wanted_) step.out_strided(column, values.data(), 0);
  }

  const Node* touched(std::uint64_t id) const {
    if (!solved_)
      throw Error::of(SHEARBUS_INVALID_VALUE, "node_id",
                      "solve() first: the nodes that were touched have no answer yet");
    const auto found = nodes_.find(id);
    return found == nodes_.end() || found->second.step != step_ ? nullptr : &found->second;
  }
  std::size_t row_of(std::uint64_t id) const {
    const Node* node = touched(id);
    if (node == nullptr)
      throw Error::of(SHEARBUS_UNKNOWN_NODE, "node_id", "node " + std::to_string(id) + " was not touched in this step");
    return node->row;
  }

  Session session_;
  std::uint32_t components_ = 1;
  bool sticks_ = false;
  bool asked_ = false;      // true from solve() to the next touch()
  bool solved_ = false;     // the same, if it was answered
  bool refused_ = false;    // the nodes of new_ were refused
  std::uint64_t step_ = 1;  // number of the present step
  std::unordered_map<std::uint64_t, Node> nodes_;
  Ids ids_, new_;  // nodes of the rows of this step; nodes that the session does not have yet
  // As many rows as make_room() has made, of which those of ids_ are in use.
  std::array<std::array<Column, 2>, kVectors> vectors_;
  std::array<Column, kScalars> scalars_;
  std::array<Column, 2> stress_;
  Column temperature_;
  std::vector<std::uint8_t> outcome_, regime_;
  std::vector<std::pair<std::uint32_t, Column>> wanted_;  // by want()
};

}  // namespace v1
}  // namespace shearbus
