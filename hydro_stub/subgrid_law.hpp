// The interface law of the subgrid service. Only this room of the hydrocode includes the client. Without an endpoint
// the server runs in this process.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "hydro_stub/interface_law.hpp"
#include "proto/wire/key_file.hpp"

namespace shearbus::hydro {

// The server that computes the layers.
struct SubgridServer {
  wire::ServerAddress address;      // no endpoint: in this process
  std::filesystem::path state_dir;  // state directory of a server in this process; empty: none
};

// A scene as the server reads it.
struct SceneText {
  std::string text;  // TOML
  std::string file;  // its name, for messages
};

// Describes the cost of the scene's parts, measured on this machine.
std::string explain(const SceneText& scene, std::size_t nodes);

class SubgridLaw : public InterfaceLaw {
 public:
  // Opens a session for the nodes. Throws wire::Error with the server's refusal.
  SubgridLaw(const SceneText& scene, std::span<const std::uint64_t> node_ids,
             std::span<const double> initial_temperature, const SubgridServer& server = {});
  // Restores the state that another process saved.
  SubgridLaw(const std::string& kept, const SubgridServer& server);
  ~SubgridLaw() override;  // leaves a session open that has a saved state and was not closed

  // A step is a trial until the next one, which commits it in the same round trip, or close().
  void advance(const InterfaceInputs& inputs, InterfaceAnswer& answer) override;
  void start(const InterfaceInputs& inputs, InterfaceAnswer& answer) override;  // sends
  void finish() override;                                                       // waits
  void take_back() override;
  LawTime time_spent() const override;
  std::string keep(const std::string& name) override;
  std::string cannot_keep() const override;
  void close() override;  // throws if that fails
  OmittedCost omitted_cost() const override;

  const std::string& server() const;                 // address of the server, for messages
  const std::vector<std::string>& warnings() const;  // warnings of the server about the scene

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace shearbus::hydro
