// Looks at the inputs of a run for values that were probably meant in another unit, or with the other sign of the
// pressure. Sessions of every language and replays of histories use it.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "client/src/options.hpp"

namespace shearbus {

class InputCheck {
 public:
  // Looks at the inputs of a step that was answered. Returns warnings, each once in a run; each begins with the name of
  // the input that it is about. After the first steps with a sound contact it looks at the step's length alone. node_ids:
  // of the rows, if the request does not name them.
  std::vector<std::string> add(const Batch& request, double dt_s, std::span<const std::uint64_t> node_ids);
  // True if the first step has drawn a warning about the units of what moves the jump.
  bool doubts_units() const { return doubts_units_; }
  // The run has ended: returns what could not be said before.
  std::vector<std::string> end();

 private:
  std::string longer_warning(double dt_s);
  std::string pressure_warning() const;  // empty: none
  std::string contact_warning() const;

  bool first_ = true;
  bool doubts_units_ = false;
  bool longer_told_ = false;      // a step far longer than those before it has been told
  double longest_ = 0.0;          // length of any step  [s]
  bool judged_ = false;           // true: the pressure needs no further look
  std::uint64_t steps_ = 0;       // of which the pressure is of interest
  std::uint64_t in_contact_ = 0;  // of these, with a node in contact
  std::uint64_t negative_ = 0;    // of these, with a negative pressure
  std::uint64_t settled_ = 0;     // steps in contact since the highest pressure has last grown by a tenth
  double lowest_ = 0.0;           // pressure of any step  [Pa]
  double highest_ = 0.0;          // pressure of any step  [Pa]
  double settled_at_ = 0.0;       // highest pressure when it has last grown by a tenth  [Pa]
  double fastest_ = 0.0;          // largest |velocity jump| in contact  [m/s]
};

}  // namespace shearbus
