// The interface law of the subgrid service. The only room of the hydrocode that knows the client; with no endpoint the
// server runs in this process.
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

// Where the layers are computed.
struct SubgridServer {
  wire::ServerAddress address;      // no endpoint: in this process
  std::filesystem::path state_dir;  // of a server in this process: where its sessions outlive it; empty: they do not
};

// A scene as the server reads it.
struct SceneText {
  std::string text;  // TOML
  std::string file;  // its name, for messages
};

// What a scene pays for, measured on this machine: for people.
std::string explain(const SceneText& scene, std::size_t nodes);

class SubgridLaw : public InterfaceLaw {
 public:
  // Opens a session for the nodes. Throws wire::Error with what the server refused.
  SubgridLaw(const SceneText& scene, std::span<const std::uint64_t> node_ids,
             std::span<const double> initial_temperature, const SubgridServer& server = {});
  // Comes back to what another process kept.
  SubgridLaw(const std::string& kept, const SubgridServer& server);
  ~SubgridLaw() override;  // of a law that was not closed: leaves the session to who comes back, if anything was kept

  // A step is a trial until the next one, which commits it in the same round trip, or close().
  void advance(const InterfaceInputs& inputs, InterfaceAnswer& answer) override;
  void start(const InterfaceInputs& inputs, InterfaceAnswer& answer) override;  // sends
  void finish() override;                                                       // waits
  void take_back() override;
  LawTime time_spent() const override;
  std::string keep(const std::string& name) override;
  std::string cannot_keep() const override;
  void close() override;  // throws where that fails
  OmittedCost omitted_cost() const override;

  const std::string& server() const;                 // where it runs, for people
  const std::vector<std::string>& warnings() const;  // what the server has to say of the scene

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace shearbus::hydro
