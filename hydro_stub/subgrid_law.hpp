// The interface law of the subgrid service. The only room of the hydrocode that knows the client; with no endpoint the
// server runs in this process.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "hydro_stub/interface_law.hpp"
#include "proto/wire/key_file.hpp"
#include "proto/wire/scene.hpp"

namespace shearbus::hydro {

class SubgridLaw : public InterfaceLaw {
 public:
  // Opens a session for the nodes. Throws wire::Error with what the server refused.
  SubgridLaw(const wire::Scene& scene, std::span<const std::uint64_t> node_ids,
             std::span<const double> initial_temperature, const wire::ServerAddress& server);
  ~SubgridLaw() override;

  // A step is a trial until the next one, which commits it in the same round trip, or close().
  void advance(const InterfaceInputs& inputs, InterfaceAnswer& answer) override;
  void take_back() override;
  LawTime time_spent() const override;

  const std::string& server() const;                 // where it runs, for people
  const std::vector<std::string>& warnings() const;  // what the server has to say of the scene
  void close();                                      // ends the session; throws where that fails

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace shearbus::hydro
