// Laws with exact solutions: no friction, as much as it takes, and the same whatever the pressure.
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

// |s| = limit while the interface slips, any s up to it while it sticks, whatever the pressure.
class ConstantFrictionLaw : public InterfaceLaw {
 public:
  explicit ConstantFrictionLaw(double limit) : limit_(limit) {}  // [Pa]
  void advance(const InterfaceInputs& inputs, InterfaceAnswer& answer) override;
  LawTime time_spent() const override { return {}; }

 private:
  double limit_;
};

}  // namespace shearbus::hydro
