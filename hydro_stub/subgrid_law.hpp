// The interface law that asks the subgrid service. Of the hydrocode only subgrid_law.cpp includes the client library.
// Without an endpoint the server runs in this process.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "hydro_stub/interface_law.hpp"
#include "proto/files/key_file.hpp"

namespace shearbus::hydro {

// The server that computes the layers.
struct SubgridServer {
  files::ServerAddress address;     // without an endpoint the server runs in this process
  std::filesystem::path state_dir;  // state directory of a server in this process; empty: none
  // true: the client compares the velocity jumps that the host sends with the jumps of the answers. Two-dimensional
  // runs switch this off: there the jump also changes as the interface turns and as neighbouring nodes share momentum.
  bool check_closure = true;
};

// The scene in the form that the server reads.
struct SceneText {
  std::string text;  // text of the scene  (TOML)
  std::string file;  // file name of the text, for messages
};

// Returns a text on the parts of the subgrid model that the scene switches on, with their cost measured on this
// machine.
std::string explain(const SceneText& scene, std::size_t nodes);

class SubgridLaw : public InterfaceLaw {
 public:
  // Opens a session for the nodes. Throws wire::Error with the server's refusal.
  // layer_thickness: of each node's layer; empty: the scene's  [m]
  SubgridLaw(const SceneText& scene, std::span<const std::uint64_t> node_ids,
             std::span<const double> initial_temperature, const SubgridServer& server = {},
             std::span<const double> layer_thickness = {});
  // Resumes the session of another process and restores the state `kept` that keep() saved there.
  SubgridLaw(const std::string& kept, const SubgridServer& server);
  ~SubgridLaw() override;  // a session that has a saved state and was not closed stays open

  // A step stays a trial until the next advance(), which commits it in the same round trip, or until keep() or close().
  void advance(const InterfaceInputs& inputs, InterfaceAnswer& answer) override;
  void start(const InterfaceInputs& inputs, InterfaceAnswer& answer) override;  // sends the request
  void finish() override;                                                       // waits for the answer
  void take_back() override;
  wire::Batch profiles(std::span<const std::uint64_t> node_ids, std::span<const double> pressure_pa) override;
  LawTime time_spent() const override;
  std::string keep(const std::string& name) override;
  std::string cannot_keep() const override;
  void close() override;  // throws if the session cannot be closed
  OmittedCost omitted_cost() const override;

  const std::vector<std::string>& warnings() const;  // warnings of the server about the scene

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace shearbus::hydro
