#include "server/service/columns.hpp"

#include <array>
#include <cstdint>
#include <iterator>
#include <utility>

#include "proto/wire/messages.hpp"
#include "server/service/scene_model.hpp"

namespace shearbus::service {

using physics::LedgerTerm;
using physics::ModelOptions;
using physics::TileInputs;
using shard::Shard;
using shard::TileAnswers;
using wire::Field;

// The numbers of the solver's regimes and outcome bits are sent unchanged, as bytes of a reply: both are printed from the
// schema (proto/print_contract.py).
namespace {

static_assert(wire::kLedgerColumns.size() == physics::kLedgerTerms);

// ---- columns of a message, and the tile members that they fill or are filled from ----

// Members of a tile for the second tangential component have the first component's name with the prefix `second_`.
#define SECOND_Scalar(rows, enumerator, quantity)
#define SECOND_Tangential(rows, enumerator, quantity) rows(enumerator, 1, second_##quantity)

struct InputRow {
  Field field;
  std::uint32_t component;
  double (TileInputs::*member)[physics::kLanes];
};
constexpr InputRow kInputs[] = {
#define ROW(enumerator, component, member) {Field::enumerator, component, &TileInputs::member},
#define INPUT(enumerator, number, name, quantity, unit, direction, ...) \
  ROW(enumerator, 0, quantity) SECOND_##direction(ROW, enumerator, quantity)
#include "proto/wire/columns.inc"
#undef ROW
};

struct LedgerRow {
  Field field;
  LedgerTerm term;
};
constexpr LedgerRow kLedger[] = {
#define LEDGER(enumerator, term, ...) {Field::enumerator, LedgerTerm::term},
#include "proto/wire/columns.inc"
};

// If the reply has a column of this field and component, adds it to `columns` with the tile member that fills it.
template <typename Lane, typename Of>
void add_answer(Lane (Of::*member)[physics::kLanes], wire::Batch& reply, Field field, std::uint32_t component,
                std::vector<shard::OutputColumn>& columns) {
  if (!reply.has(field, component)) return;
  if constexpr (std::is_same_v<Lane, double>)
    columns.emplace_back(shard::AnswerColumn<double, double>{member, reply.f64(field, component)});
  else
    columns.emplace_back(shard::AnswerColumn<Lane, std::uint8_t>{member, reply.u8(field, component)});
}

// Adds far-field columns that give the momentum balance of a request in stick form, DLP (61). That balance depends on
// the masses m and the stresses s of the host only by the impedance Z = 1 / (dt (1/m_soft + 1/m_hard)) and by the stick
// stress Z [V]free = Z [V]old + (s_soft/m_soft + s_hard/m_hard) / (1/m_soft + 1/m_hard), with the jump [V]old before
// the step and the jump [V]free after a step without friction. Equal masses m = 2 dt Z and equal stresses s = stick
// stress - Z [V]old have the same Z and the same stick stress.
void add_stick_form(const wire::Batch& request, double dt, shard::StepColumns& columns) {
  const std::span<const double> impedance = request.f64(Field::kImpedance);
  const std::size_t rows = impedance.size();
  const std::uint32_t components = request.has(Field::kStickStress, 1) ? 2 : 1;
  columns.converted.resize((1 + components) * rows);
  const std::span<double> mass = std::span(columns.converted).first(rows);
  for (std::size_t row = 0; row < rows; ++row) mass[row] = 2.0 * dt * impedance[row];
  columns.inputs.push_back({&TileInputs::mass_soft, mass});
  columns.inputs.push_back({&TileInputs::mass_hard, mass});
  for (std::uint32_t component = 0; component < components; ++component) {
    const std::span<const double> stick = request.f64(Field::kStickStress, component);
    const std::span<const double> jump = request.f64(Field::kVelocityJump, component);
    const std::span<double> stress = std::span(columns.converted).subspan((1 + component) * rows, rows);
    for (std::size_t row = 0; row < rows; ++row) stress[row] = stick[row] - impedance[row] * jump[row];
    columns.inputs.push_back({component == 0 ? &TileInputs::stress_soft : &TileInputs::second_stress_soft, stress});
    columns.inputs.push_back({component == 0 ? &TileInputs::stress_hard : &TileInputs::second_stress_hard, stress});
  }
}

// ---- columns that only models with certain options have ----

using physics::ModelOptions;
using shard::Shard;

template <Field kDerivative>
constexpr ColumnCondition kHasTangent = {
    kDerivative, [](const Shard&, const ModelOptions& options) { return physics::Model::can_linearise(options); },
    wire::Code::kUnsupported,
    "is of steps whose stress is given by one balance; those of a scene with tolerance, "
    "time_integrator = \"sdirk2\", two tangential components, layer.inertia, interface.plastic_layer, [melt_film], "
    "velocity_driven.taylor_quinney_factor or drive = \"interface_slip\" are given by several, or by one that the "
    "derivative does not cover",
    "Leave it out, or compare two trial steps."};

template <Field kOfStickForm>
constexpr ColumnCondition kHasOwnMasses = {
    kOfStickForm, [](const Shard&, const ModelOptions& options) { return !options.inertia; }, wire::Code::kUnsupported,
    "is of the stick form, which tells one impedance of both bodies, and with layer.inertia the mass of the layer is "
    "taken from that of the soft one",
    "Send the far-field form: stresses and masses of both half zones."};

template <Field kSum>
constexpr ColumnCondition kSumsEnergy = {
    kSum, [](const Shard& shard, const ModelOptions&) { return shard.sums_energy(); }, wire::Code::kUnsupported,
    "is of scenes with friction_energy = true", "Leave it out, or open the session with a scene that has the key."};

constexpr std::array kConditions = {
    ColumnCondition{Field::kSoftPlasticStrainRate,
                    [](const Shard&, const ModelOptions& options) { return options.plastic_layer; },
                    wire::Code::kUnsupported,
                    "has no use in a force-driven layer without interface.plastic_layer, which has no plastic strain",
                    "Leave the column out, or set interface.plastic_layer = true."},
    ColumnCondition{
        Field::kSoftShearRate,
        [](const Shard&, const ModelOptions& options) { return options.drive == physics::Drive::kInterfaceSlip; },
        wire::Code::kShape, "drives the layer only with velocity_driven.drive = \"interface_slip\"",
        "Leave the column out, or change the drive."},
    ColumnCondition{Field::kUnspecified, [](const Shard&, const ModelOptions& options) { return !options.inertia; },
                    wire::Code::kUnsupported, "is of layers with one stress, and with layer.inertia it varies",
                    "Leave out the columns of the energy ledger."},
    ColumnCondition{Field::kUnspecified, [](const Shard&, const ModelOptions& options) { return has_ledger(options); },
                    wire::Code::kUnsupported,
                    "has no term for the heat that leaves through a face with far_boundary = \"isothermal\"",
                    "Leave out the columns of the energy ledger."},
    ColumnCondition{Field::kMeanFarStress, [](const Shard&, const ModelOptions& options) { return options.inertia; },
                    wire::Code::kUnsupported,
                    "is of layers with inertia: without layer.inertia the stress is the same at both faces",
                    "Leave it out; the mean stress of the step is in mean_shear_stress_pa."},
    kHasOwnMasses<Field::kStickStress>,
    kHasOwnMasses<Field::kImpedance>,
    kHasTangent<Field::kStressPerJump>,
    kHasTangent<Field::kStressPerPressure>,
    ColumnCondition{Field::kFilmThickness,
                    [](const Shard&, const ModelOptions& options) { return options.melt_film.has_value(); },
                    wire::Code::kUnsupported, "is of scenes with the table [melt_film], and in this one nothing melts",
                    "Leave it out, or open the session with a scene that has the table."},
    ColumnCondition{
        Field::kErrorEstimate, [](const Shard&, const ModelOptions& options) { return options.tolerance.has_value(); },
        wire::Code::kUnsupported, "is of scenes with a tolerance, and this one has none: its steps are not controlled",
        "Leave it out, or open the session with a tolerance in place of cells and grading."},
    ColumnCondition{Field::kClosure, [](const Shard& shard, const ModelOptions&) { return shard.check_closure(); },
                    wire::Code::kUnsupported, "is of sessions that check closure",
                    "Leave it out, or open the session with open_session.check_closure."},
    kSumsEnergy<Field::kFrictionEnergySoft>,
    kSumsEnergy<Field::kFrictionEnergyHard>,
};

}  // namespace

std::string name_of(const wire::Column& column) {
  return std::string(wire::name(column.field)) + (column.component == 0 ? "" : "_second");
}

wire::Strategy strategy_of(const physics::ModelOptions& options) {
  return options.strategy == physics::Strategy::kForceDriven ? wire::Strategy::kForceDriven
                                                             : wire::Strategy::kVelocityDriven;
}

const ColumnCondition* unmet_condition(Field field, const Shard& shard) {
  const ModelOptions& options = shard.model().options();
  const wire::ColumnRow* row = wire::find_column(field);
  if (row == nullptr || row->use(strategy_of(options)) == wire::Use::kNone) return nullptr;
  const Field group = row->kind == wire::Kind::kLedger ? Field::kUnspecified : field;
  for (const ColumnCondition& condition : kConditions)
    if (condition.field == group && !condition.holds(shard, options)) return &condition;
  return nullptr;
}

std::vector<Field> columns_met(std::span<const Field> columns, const Shard& shard) {
  std::vector<Field> met;
  std::ranges::copy_if(columns, std::back_inserter(met), [&](Field field) { return !unmet_condition(field, shard); });
  return met;
}

shard::StepColumns step_columns(const wire::Batch& request, wire::Batch& reply, double dt, shard::StepColumns memory) {
  shard::StepColumns columns = {.inputs = std::move(memory.inputs),
                                .converted = std::move(memory.converted),
                                .outputs = std::move(memory.outputs)};
  columns.inputs.clear();
  columns.outputs.clear();
  for (const InputRow& row : kInputs)
    if (request.has(row.field, row.component))
      columns.inputs.push_back({row.member, request.f64(row.field, row.component)});
  if (request.has(Field::kImpedance)) add_stick_form(request, dt, columns);
#define ROW(enumerator, component, member) \
  add_answer(&TileAnswers::member, reply, Field::enumerator, component, columns.outputs);
#define OUTPUT(enumerator, number, name, quantity, unit, element, direction, ...) \
  ROW(enumerator, 0, quantity) SECOND_##direction(ROW, enumerator, quantity)
#include "proto/wire/columns.inc"
#undef ROW
  columns.wants_mean_stress = reply.has(Field::kMeanShearStress) || reply.has(Field::kMeanFarStress);
  columns.wants_tangent = reply.has(Field::kStressPerJump) || reply.has(Field::kStressPerPressure);
  columns.wants_time_to_melting = reply.has(Field::kTimeToMelting);
  for (std::uint32_t component = 0; component < 2; ++component)
    if (reply.has(Field::kClosure, component)) columns.closure[component] = reply.f64(Field::kClosure, component);
  for (const LedgerRow& row : kLedger)
    if (reply.has(row.field)) columns.outputs.emplace_back(shard::LedgerColumn{row.term, reply.f64(row.field)});
  return columns;
}

}  // namespace shearbus::service
