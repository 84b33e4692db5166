// The two limits of friction: none, and as much as it takes.
#pragma once

#include "hydro_stub/interface_law.hpp"

namespace shearbus::hydro {

class FreeSlipLaw : public InterfaceLaw {
 public:
  void advance(const InterfaceInputs& inputs, InterfaceAnswer& answer) override;
  LawTime time_spent() const override { return {}; }
};

// Bodies under pressure do not slip.
class StickLaw : public InterfaceLaw {
 public:
  void advance(const InterfaceInputs& inputs, InterfaceAnswer& answer) override;
  LawTime time_spent() const override { return {}; }
};

}  // namespace shearbus::hydro
