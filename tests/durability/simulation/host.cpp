#include "tests/durability/simulation/host.hpp"

#include <algorithm>
#include <limits>
#include <utility>

namespace shearbus::simulation {

Host::Host(World& world, Tally& tally, Ledger& ledger, support::ServiceHarness& reference, unsigned number,
           Strategy strategy, std::size_t rows)
    : world_(world),
      tally_(tally),
      ledger_(ledger),
      number_(number),
      rows_(rows),
      strategy_(strategy),
      connection_(std::make_shared<SimulatedConnection>(world)),
      client_(insist([&] { return Client(std::shared_ptr<Connection>(connection_)); })),
      reference_connection_(std::make_shared<DirectConnection>(reference)),
      reference_client_(std::shared_ptr<Connection>(reference_connection_)),
      session_(insist([&] {
        return client_.open(support::text_of(support::scene_of(strategy_)), "scene", first_nodes(), {.domain = "run"});
      })),
      reference_(reference_client_.open(support::text_of(support::scene_of(strategy_)), "scene", first_nodes(),
                                        {.domain = "run"})) {
  ledger_.add(reference_.node_ids);
  connection_->set_max_rows(rows_);
  reference_connection_->set_max_rows(rows_);
}

void Host::act() {
  ++tally_.calls;
  if (world_.chance(10)) return die_and_be_succeeded();
  if (world_.chance(12)) return ask_nonsense();
  if (world_.chance(12)) return mark();
  if (!marks_.empty() && world_.chance(15)) return go_back();
  if (world_.chance(3)) return change_nodes();
  const int number = steps_++;
  const unsigned choice = world_.random() % 4;
  if (choice == 0) {
    step(number, wire::Mode::kAdvance);
  } else {
    step(number, wire::Mode::kTrial);
    if (choice == 1) {
      ASSERT_EQ(insist([&] { return session_.commit(); }), reference_.commit());
    }
    if (choice == 2) {
      ASSERT_EQ(insist([&] { return session_.rollback(); }), reference_.rollback());
    }
    if (choice == 3) step(number + 1, wire::Mode::kTrial, true);
  }
}

std::uint64_t Host::nodes_of_server() {
  return insist([&] { return client_.server_status().nodes; });
}

void Host::close() {
  const auto totals = insist([&] { return session_.close(); });
  const auto expected = reference_.close();
  ASSERT_EQ(totals.requests, expected.requests);
  ASSERT_EQ(totals.node_steps, expected.node_steps);
}

const StepResult& Host::made(Session& session, const Batch& columns, wire::Mode mode, bool commit_previous) {
  const StepOptions options{.dt_s = 1e-9, .commit_previous = commit_previous};
  return mode == wire::Mode::kAdvance ? session.advance(columns, options) : session.trial(columns, options);
}

void Host::step(int number, wire::Mode mode, bool commit_previous) {
  const Batch columns = support::step_columns(strategy_, nodes(), number);
  const StepResult& expected = made(reference_, columns, mode, commit_previous);
  const StepResult* answer = insist([&] { return &made(session_, columns, mode, commit_previous); });
  ASSERT_EQ(answer->upscale().state_version, expected.upscale().state_version);
  ASSERT_EQ(answer->upscale().nodes, expected.upscale().nodes);
  const auto bits = [](std::span<const double> column) { return std::as_bytes(column); };
  for (const auto& [a, b] :
       {std::pair{bits(answer->shear_stress_pa()), bits(expected.shear_stress_pa())},
        {bits(answer->interface_temperature_k()), bits(expected.interface_temperature_k())},
        {bits(answer->batch().f64(Field::kSlidingVelocity)), bits(expected.batch().f64(Field::kSlidingVelocity))},
        {bits(answer->batch().f64(Field::kFrictionHeat)), bits(expected.batch().f64(Field::kFrictionHeat))}})
    ASSERT_TRUE(std::equal(a.begin(), a.end(), b.begin(), b.end())) << "step " << number;
}

std::vector<std::uint64_t> Host::some_nodes() {
  std::vector<std::uint64_t> picked = nodes();
  std::shuffle(picked.begin(), picked.end(), world_.random);
  picked.resize(std::min<std::size_t>(picked.size(), 1 + world_.random() % 5));
  return picked;
}

void Host::change_nodes() {
  ++tally_.node_changes;
  switch (world_.random() % 4) {
    case 0:
      return register_some();
    case 1:
      return retire_some();
    case 2:
      return offer_some();
    default:
      return accept_one();
  }
}

void Host::register_some() {
  std::vector<std::uint64_t> ids;
  for (unsigned i = 0; i <= world_.random() % 5; ++i)
    if (!ledger_.free.empty() && world_.chance(2)) {
      ids.push_back(ledger_.free.back());
      ledger_.free.pop_back();
    } else {
      ids.push_back(ledger_.next_id++);
    }
  // With some probability adds the id of an existing node, which makes the server refuse the request.
  if (world_.chance(10) && !ledger_.nodes.empty()) ids.push_back(*ledger_.nodes.begin());
  if (both([&] { return session_.register_nodes(ids), 0; }, [&] { reference_.register_nodes(ids); }) == Code::kOk)
    ledger_.add(ids);
}

void Host::retire_some() {
  const auto ids = some_nodes();
  if (ids.empty()) return;
  if (both([&] { return session_.retire_nodes(ids), 0; }, [&] { reference_.retire_nodes(ids); }) != Code::kOk) return;
  ledger_.drop(ids);
  ledger_.free.insert(ledger_.free.end(), ids.begin(), ids.end());
}

void Host::offer_some() {
  Ledger::Offer offer{.giver = number_, .transfer = {}, .of_reference = {}, .nodes = some_nodes()};
  if (offer.nodes.empty()) return;
  if (both([&] { return offer.transfer = session_.offer_nodes(offer.nodes); },
           [&] { offer.of_reference = reference_.offer_nodes(offer.nodes); }) == Code::kOk)
    ledger_.offers.push_back(std::move(offer));
}

void Host::accept_one() {
  if (ledger_.offers.empty()) return;
  Ledger::Offer& offer = ledger_.offers[world_.random() % ledger_.offers.size()];
  std::vector<std::uint64_t> accepted;
  if (both(
          [&] {
            const auto nodes = session_.accept_nodes(offer.transfer);
            return accepted.assign(nodes.begin(), nodes.end()), 0;
          },
          [&] { reference_.accept_nodes(offer.of_reference); }) != Code::kOk)
    return;
  ASSERT_TRUE(offer.waits) << "an offer was taken twice";
  ASSERT_EQ(accepted, offer.nodes);
  offer.waits = false;
  tally_.moved += accepted.size();
}

void Host::mark() {
  const std::string name = "dump " + std::to_string(steps_);
  ASSERT_EQ(insist([&] { return session_.mark(name).names; }), reference_.mark(name).names);
  marks_.push_back({.name = name, .nodes = nodes(), .offers_before = ledger_.offers.size()});
}

void Host::go_back() {
  const std::size_t newest = std::min<std::size_t>(3, marks_.size());
  const Mark mark = marks_[marks_.size() - 1 - world_.random() % newest];
  const auto before = nodes();
  if (both([&] { return session_.rollback_to(mark.name); }, [&] { reference_.rollback_to(mark.name); }) != Code::kOk)
    return;
  const auto newest_of_name =
      std::find_if(marks_.rbegin(), marks_.rend(), [&](const Mark& m) { return m.name == mark.name; });
  ASSERT_EQ(nodes(), newest_of_name->nodes);
  ledger_.drop(before);
  for (std::size_t i = newest_of_name->offers_before; i < ledger_.offers.size(); ++i) {
    Ledger::Offer& offer = ledger_.offers[i];
    if (offer.giver != number_ || !std::exchange(offer.waits, false)) continue;
    ledger_.drop(offer.nodes);
  }
  for (const std::uint64_t id : nodes()) std::erase(ledger_.free, id);
  ledger_.add(nodes());
}

void Host::ask_nonsense() {
  if (nodes().size() < 2) return;
  Batch columns = support::step_columns(strategy_, nodes(), 0);
  columns.f64(Field::kPressure)[1] = std::numeric_limits<double>::infinity();
  try {
    insist([&] { return &session_.advance(columns, {.dt_s = 1e-9}); });
    FAIL() << "nonsense was answered";
  } catch (const Error& fault) {
    ASSERT_EQ(fault.status().code, Code::kInvalidValue) << fault.what();
  }
}

void Host::die_and_be_succeeded() {
  ++tally_.successors;
  const Batch columns = support::step_columns(strategy_, nodes(), steps_++);
  const auto offered = world_.chance(2) ? some_nodes() : std::vector<std::uint64_t>();
  const std::uint64_t before = session_.last_sequence;
  connection_->set_max_rows(wire::kMaxRowsPerMessage);  // so that its last step is one request
  connection_->dies_next = true;
  try {
    if (offered.empty())
      session_.advance(columns, {.dt_s = 1e-9});
    else
      session_.offer_nodes(offered);
  } catch (const Error&) {
  }
  const Session::Ticket ticket = session_.ticket();
  session_.leave();
  connection_ = std::make_shared<SimulatedConnection>(world_);
  client_ = insist([&] { return Client(std::shared_ptr<Connection>(connection_)); });
  connection_->set_max_rows(rows_);
  session_ = insist([&] { return client_.resume(ticket); });
  ASSERT_LE(session_.last_sequence, before + 1);
  ASSERT_GE(session_.last_sequence, before);
  reference_connection_->set_max_rows(wire::kMaxRowsPerMessage);
  if (session_.last_sequence == before + 1) {
    if (offered.empty())
      reference_.advance(columns, {.dt_s = 1e-9});
    else
      ledger_.offers.push_back({.giver = number_,
                                .transfer = session_.offers.back(),
                                .of_reference = reference_.offer_nodes(offered),
                                .nodes = offered});
  }
  reference_connection_->set_max_rows(rows_);
  std::vector<TransferId> waiting;
  for (const Ledger::Offer& offer : ledger_.offers)
    if (offer.giver == number_ && offer.waits) waiting.push_back(offer.transfer);
  ASSERT_EQ(session_.offers, waiting);
  ASSERT_EQ(session_.node_ids, reference_.node_ids);
}

}  // namespace shearbus::simulation
