// Interface laws with exact solutions: free slip, stick, and a friction stress that does not depend on the pressure.
#pragma once

#include "hydro_stub/interface_law.hpp"

namespace shearbus::hydro {

class FreeSlipLaw : public InterfaceLaw {
 public:
  void advance(const InterfaceInputs& inputs, InterfaceAnswer& answer) override;
};

// Sticks wherever the pressure is positive.
class StickLaw : public InterfaceLaw {
 public:
  void advance(const InterfaceInputs& inputs, InterfaceAnswer& answer) override;
};

// |s| = limit while the interface slips and |s| <= limit while it sticks, whatever the pressure.
class ConstantFrictionLaw : public InterfaceLaw {
 public:
  explicit ConstantFrictionLaw(double limit) : limit_(limit) {}  // [Pa]
  void advance(const InterfaceInputs& inputs, InterfaceAnswer& answer) override;

 private:
  double limit_;
};

}  // namespace shearbus::hydro
