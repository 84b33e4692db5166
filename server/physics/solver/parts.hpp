// The parts of which a model can be made, and which of them exclude each other; no other file has such rules. A part is
// an option of the model or a kind of law, and has one row and one Property. Every pair of rows in parts_table.hpp must be
// decided, or that file does not compile: the later row lists the earlier one as compatible, so that the two may be on
// together; or the pair is excluded with a reason; or the two never meet, because each strategy excludes one of them.
// What is an option of what is no exclusion: a part names what it needs, and kChoices of parts_table.hpp lists the parts of
// which a model has one. Model's constructor, the service, the options page and the tests read the same rows.
#pragma once

#include <cstdint>
#include <initializer_list>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "server/physics/solver/model.hpp"

namespace shearbus::physics {

// The properties of a model that can exclude each other, in the order of the table in parts_table.hpp. A new property goes to
// the end, because its row of the table must say with which of all earlier properties it may be on together.
enum class Property : std::uint8_t {
  kVelocityDriven,
  kForceDriven,
  kInterfaceSlip,
  kCoulombLimit,
  kConductingHardBody,
  kFixedHeatShare,
  kPlasticHeating,
  kInertia,
  kPlasticLayer,
  kJunctions,
  kSlipDependentFriction,
  kFirstOrderFlow,
  kFlowWithPressureTerm,
  kMeltingCurve,
  kCompressedPressureTerm,
  kSecondOrder,
  kModes,
  kSleep,
  kTolerance,
  kTwoComponents,
  kTemperatureDependentFriction,
  kFrictionWithState,
  kIsothermalEnd,
  kSimonMelting,
  kMeltFilm,
  kFlowWithoutBracket,
  kFlowingLayer,
  kVaryingHeat,
};
inline constexpr int kProperties = 28;

class Properties {
 public:
  constexpr Properties() = default;
  constexpr Properties(std::initializer_list<Property> members) {
    for (const Property p : members) bits_ |= bit(p);
  }
  constexpr Properties operator|(Properties other) const {
    other.bits_ |= bits_;
    return other;
  }
  constexpr Properties operator-(Properties other) const {
    other.bits_ = bits_ & ~other.bits_;
    return other;
  }
  // Those that come before p in the order of Property.
  static constexpr Properties before(Property p) {
    Properties all;
    all.bits_ = bit(p) - 1;
    return all;
  }
  constexpr bool has(Property p) const { return (bits_ & bit(p)) != 0; }
  constexpr bool empty() const { return bits_ == 0; }
  constexpr void add(Property p) { bits_ |= bit(p); }

 private:
  static constexpr std::uint64_t bit(Property p) { return std::uint64_t{1} << static_cast<unsigned>(p); }
  std::uint64_t bits_ = 0;
};

// The row of one property in the table of parts_table.hpp. A property of flow or friction laws has an empty `value`, because
// a scene gives the name of the law there, and empty texts, because each law declares its own.
struct Part {
  Property property{};
  std::string_view key{};    // key of a scene, for example "layer.inertia"
  std::string_view value{};  // value of the key that switches the property on, as in a scene: for example "true"
  bool (*is_on)(const ModelOptions&) = nullptr;
  // Switches the part on (with typical values of its parameters) or off. Null for a part that cannot be switched, such
  // as a strategy: every model has one.
  void (*set)(ModelOptions&, bool on) = nullptr;
  Properties goes_with{};       // those of the earlier properties that may be on together with this one
  Properties needs{};           // what this property is an option of: parts that must be on where it is
  std::string_view law_with{};  // name of a law with this property, for example "friction law that depends on slip"
  // Texts for shearbus-ctl options: equation, what the property adds, when to use it; empty: it omits the property.
  std::string_view equation{};
  std::string_view adds{};
  std::string_view when{};
  // Instructions of a node-step over those without the option, by strategy; printed by tests/bench/option_costs.py. Every
  // option has it, or parts_table.hpp does not compile.
  std::string_view cost{};
};
std::span<const Part> parts();
const Part& part_of(Property property);
// Unique name of a part that can be switched: its key, or key = value if an earlier part has that key.
std::string unique_key(const Part& part);
// The key of a part in a scene with these options: plastic-work heating has one in the table of each strategy.
std::string_view key_of(const Part& part, const ModelOptions& options);
// The setting that switches a part on, as a scene writes it: `layer.inertia = true`, `[junctions]`, `soft.flow_law =
// "johnson_cook"`.
std::string setting_of(const Part& part, const ModelOptions& options);

// What a page calls a part: its setting, "a <law with this property>" or "a layer that flows".
std::string name_of(const Part& part, const ModelOptions& options);

// Properties that exclude each other for one reason: each of `first` each of `second`. A refusal names the key of the
// one of `first`.
struct Exclusion {
  Properties first;
  Properties second;
  std::string_view reason;
};
std::span<const Exclusion> exclusions();

// Parts of which a model has one, or at most one.
std::span<const Properties> choices();

// One reason why a model with the options of a scene cannot be made.
struct Refusal {
  std::string key;     // key of a scene, for example "layer.inertia"
  std::string text;    // one sentence that begins with this key as a scene writes it: "[junctions]"
  std::string remedy;  // one sentence: the change that removes this reason
};

// All reasons why a model with these options cannot be made; empty if it can. Tests ask with other tables.
std::vector<Refusal> refusals(const ModelOptions& options, std::span<const Part> rows = parts(),
                              std::span<const Exclusion> excluded = exclusions());

// Whether the properties of two parts may be on together: no exclusion names both, and the part that comes later in the
// table of parts_table.hpp lists the other property in goes_with.
bool go_together(const Part& a, const Part& b, std::span<const Exclusion> exclusions);

Properties properties_of(const ModelOptions& options);

// Whether `property` may be on together with every other property of `options`; `options` may have it already.
bool goes_with(Property property, const ModelOptions& options);

// Returns the options with a part switched on or off. Options with a tolerance get grid and methods chosen anew for the
// tolerance.
ModelOptions switched(ModelOptions options, const Part& part, bool on);

// Thrown by Model's constructor; what() is the text of all refusals, one per line.
class RefusedOptions : public std::invalid_argument {
 public:
  explicit RefusedOptions(std::vector<Refusal> found);
  std::vector<Refusal> refusals;
};

}  // namespace shearbus::physics
