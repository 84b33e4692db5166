// A step: checked, journaled, computed in slices, committed and answered.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <limits>
#include <new>
#include <optional>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "proto/wire/columns.hpp"
#include "proto/wire/status.hpp"
#include "proto/wire/text.hpp"
#include "server/service/columns.hpp"
#include "server/service/member.hpp"
#include "server/service/service.hpp"
#include "server/service/validate.hpp"

namespace shearbus::service {

using wire::Code;
using wire::Field;

namespace {

// number of commits after which a check of what the host sends is over
constexpr std::uint64_t kWatched = 101;

// Adds a warning to the reply if the layers that flow are not the half zones that move with their interface nodes, in
// most of the closed contacts. Half zones differ a little from density times thickness: by the curvature of an
// axisymmetric interface, and where a contact covers a part of a node's area.
void report_layers(const shard::Shard& shard, const wire::Batch& batch, const shard::Rows& rows,
                   wire::Upscale& upscale) {
  if (!shard.model().options().plastic_layer || !batch.has(Field::kMassSoft) || shard.state_version() > kWatched)
    return;
  const auto mass = batch.f64(Field::kMassSoft), pressure = batch.f64(Field::kPressure);
  constexpr double kNear = 1.5;  // ratio of thicknesses from which on they count as different
  struct Found {
    std::size_t closed = 0, other = 0;
    std::uint64_t node = 0;
    double layer = 0.0, half_zone = 0.0;
  } found;
  for (std::size_t row = 0; row < mass.size(); ++row) {
    if (!(pressure[row] > 0.0)) continue;
    ++found.closed;
    const physics::ModelOptions& options = shard.model_of(slot_of(shard.nodes(), rows, row)).options();
    const double half_zone = mass[row] / options.soft.density, layer = options.grid.thickness;
    if (layer < kNear * half_zone && half_zone < kNear * layer) continue;
    if (found.other++ != 0) continue;
    found.node = node_of(shard.nodes(), rows, batch, row);
    found.layer = layer;
    found.half_zone = half_zone;
  }
  if (2 * found.other <= found.closed) return;
  upscale.warnings.push_back(fmt::format(
      "layer.thickness_m: the plastic layer of node {} is {:.4g} m thick, and what moves with its interface node "
      "{:.4g} m (mass_soft_kg_per_m2 over the density); {} of {} closed nodes differ so. The answer then depends on "
      "the zones: set layer.thickness_m, or where zones differ the parameter of each node, to {} the zone at the "
      "wall",
      found.node, found.layer, found.half_zone, found.other, found.closed,
      shard.model().options().inertia ? "a little less than half" : "half"));
}

// What a host does whose time grows by another length than dt.
std::string_view reason_of_time(double grown, double dt) {
  constexpr std::pair<double, std::string_view> kUnits[] = {
      {1e3, "time_s looks like ms"}, {1e6, "time_s looks like us"}, {1e9, "time_s looks like ns"}};
  for (const auto& [factor, text] : kUnits)
    if (std::abs(grown - factor * dt) <= 1e-6 * factor * dt) return text;
  return "its layers take other steps than the host. dt_s is the step of time; a factor of the momentum balance, such "
         "as gamma of a Newmark scheme, belongs to the masses or to the impedance";
}

// Adds to the reply the largest difference between a jump of the host and the answered one, and a warning if the host's
// times do not fit dt.
void report_closure(const shard::Shard& shard, const wire::Downscale& step, const wire::Batch& batch,
                    const shard::Rows& rows, const shard::Closure& closure, wire::Upscale& upscale) {
  if (rows.all ? shard.nodes().size() == 0 : rows.slots.empty()) return;
  upscale.largest_closure_m_per_s = std::max(0.0, closure.largest);
  upscale.closure_node = node_of(shard.nodes(), rows, batch, closure.row);
  upscale.layer_time_s = shard.layer_time(slot_of(shard.nodes(), rows, closure.row));
  if (shard.state_version() > kWatched || closure.timed == 0 || closure.agree != 0) return;
  upscale.warnings.push_back(fmt::format(
      "time_s: the host's time grew by {:.9g} s since the last step of node {}, and dt_s is {:.9g} s: {}. The layer's "
      "own time of node {} is {:.9g} s at the host's {:.9g} s",
      closure.host_time_step, node_of(shard.nodes(), rows, batch, closure.time_row), step.dt_s,
      reason_of_time(closure.host_time_step, step.dt_s), upscale.closure_node, upscale.layer_time_s, step.time_s));
}

}  // namespace

std::span<const std::uint8_t> Service::RunningStep::outcomes() const {
  return unasked.empty() ? std::as_const(reply->batch).u8(Field::kOutcome) : std::span(unasked);
}

void PendingFrames::copy() noexcept try {
  const std::lock_guard lock(copying_);
  if (std::exchange(copied_, true)) return;
  for (std::size_t i = 0; i < frames_.size(); ++i) copies_[i].assign(frames_[i].begin(), frames_[i].end());
} catch (const std::bad_alloc&) {
  no_memory_ = true;
}

std::array<std::vector<std::byte>, 2> PendingFrames::take() {
  copy();
  const std::lock_guard lock(copying_);
  if (no_memory_) throw std::bad_alloc();
  return std::move(copies_);
}

void Service::RunningStep::clear() noexcept {
  if (run && !shard::Shard::is_small(*run)) run.reset();
  RunningStep blank;
  blank.columns = std::move(columns);
  blank.unasked = std::move(unasked);
  blank.unasked.clear();
  blank.run = std::move(run);
  *this = std::move(blank);
}

// Whether the request is the part behind the one that is being computed. It waits until that part has run.
bool Service::follows_running(const Member& member, const Arrival& arrival) const {
  if (!member.running || !may_wait_) return false;
  const auto* part = std::get_if<wire::Downscale>(&arrival.request.body);
  return part != nullptr && part->part > 1 && part->follows == member.running->hash &&
         arrival.request.sequence == member.running->request.sequence + 1;
}

Service::ReplyPtr Service::downscale(Member& member, Arrival& arrival, const ReplyPtr& reply) {
  if (member.long_request != nullptr && must_wait(member)) return reply;
  if (!member.running) {
    if (member.pairs.several() && make_operators(member, arrival)) return nullptr;
    member.running = begin_step(member, arrival, reply);
    try {
      while (!slice(member)) {
        if (may_wait_) {
          wait_for_work(member, arrival.frames);
          turn_ = Turn::kComputing;
          return reply;
        }
        if (replaying_ && options_.while_replaying) options_.while_replaying();
      }
    } catch (...) {
      member.running.reset();
      throw;
    }
  } else if (!member.running->done || member.running->hash != arrival.hash) {
    must_wait(member);
    return reply;
  }
  return end_step(member, arrival);
}

// Makes the operators of the step, of each of many pairs, aside. Returns true if it has, as a task: its request is then
// asked again and finds them.
bool Service::make_operators(Member& member, const Arrival& arrival) {
  const auto& step = std::get<wire::Downscale>(arrival.request.body);
  const double dt = step.dt_s;
  if (dt == member.operators_made_for) return false;
  check_times(step, member.shard->model().options());
  hold(member);
  aside(bytes_of_models(member.shard->pairs().size(), true), [&] { member.shard->operators(dt); });
  member.operators_made_for = dt;
  return turn_of_ != nullptr;
}

// The session whose complete step was begun with these frames; null if there is none. The request was checked when it
// came, so it is not decoded again.
Service::Member* Service::computed_for(Frames frames) const {
  const auto found = std::ranges::find_if(computed_, [&](const Member* member) {
    return !frames.empty() && member->running->frames[0].data() == frames[0].data();
  });
  return found != computed_.end() ? *found : nullptr;
}

Service::ReplyPtr Service::end_step(Member& member, const Arrival& arrival) {
  std::unique_ptr<RunningStep> running = std::move(member.running);
  std::erase(journaled_, &member);
  std::erase(computed_, &member);
  journaled_now_ = journaled_now_ || running->journaled;
  current_.verb = running->request.body.index();
  current_.sum = running->sum;
  if (running->pending) running->pending->copy();
  end_step(member, *running, arrival);
  ReplyPtr reply = running->reply;
  recycle(std::move(running));
  return reply;
}

void Service::wait_for_work(Member& member, Frames frames) {
  RunningStep& running = *member.running;
  std::ranges::copy(frames.first(std::min(frames.size(), running.frames.size())), running.frames.begin());
  journaled_.reserve(journaled_.size() + 1);
  computed_.reserve(computed_.size() + computing_.size() + 1);
  // A user's share starts at the least solver time of those who wait: idle time earns no credit.
  User& owner = user(member.identity);
  std::uint64_t least = std::numeric_limits<std::uint64_t>::max();
  bool waits = false;
  for (const Member* other : computing_) {
    least = std::min(least, user(other->identity).turn_ns);
    waits = waits || other->identity == member.identity;
  }
  if (!waits && !computing_.empty()) owner.turn_ns = std::max(owner.turn_ns, least);
  computing_.push_back(&member);
  running.journaled = std::exchange(journaled_now_, false);
  if (running.journaled) journaled_.push_back(&member);
}

// Does everything that can fail: checks, factorisation, memory, the journal. Then begins the step. A step with policy
// all-or-nothing is computed apart from the states and journaled when it has succeeded.
std::unique_ptr<Service::RunningStep> Service::begin_step(Member& member, Arrival& arrival, const ReplyPtr& reply) {
  shard::Shard& shard = *member.shard;
  auto running = used_step_ ? std::move(used_step_) : std::make_unique<RunningStep>();
  running->request = std::move(arrival.request);
  running->hash = arrival.hash;
  running->sum = arrival.sum;
  running->started_ns = arrival.started_ns;
  running->reply = reply;
  const wire::Request& request = running->request;
  const wire::Downscale& step = running->step();
  const physics::ModelOptions& options = shard.model().options();
  const std::span<const Field> wanted = check_wanted(step, shard);
  running->extends_trial = step.part > 1;
  if (step.follows != 0) check_follows(step, member.conversation.last_hash());
  check_part(step, request.batch, member.parts ? &*member.parts : nullptr);
  running->rows = check_step(step, request.batch, shard);
  check_layer_masses(step.dt_s, request.batch, running->rows, shard);
  if (running->extends_trial) check_rows_of_part(request.batch, running->rows, *member.parts);
  const bool commits = step.commit_previous && !previous_committed_;
  if (commits && !member.trial_stands())
    refuse(Code::kNothingToCommit, "", "commit_previous is set, and no trial is standing",
           "Set it only after a trial that was neither committed nor rolled back.");
  running->operators = shard.operators(step.dt_s);
  const shard::Rows& rows = running->rows;
  const std::size_t num_rows = rows.all ? shard.nodes().size() : rows.slots.size();
  recycle(member.conversation.forget_before());
  // The shard writes each row of each column.
  reply->batch = std::move(used_batch_);
  reply->batch.reshape(wanted, num_rows, static_cast<std::uint32_t>(options.tangential_components));
  reply->body.emplace<wire::Upscale>();
  shard::StepColumns& columns = running->columns =
      step_columns(request.batch, reply->batch, step.dt_s, std::move(running->columns));
  columns.host_time = step.time_s;
  if (!reply->batch.has(Field::kOutcome)) {
    running->unasked.resize(num_rows);
    columns.outputs.emplace_back(
        shard::AnswerColumn<std::uint8_t, std::uint8_t>{&physics::TileOutputs::outcome, std::span(running->unasked)});
  }
  if (step.part == 1 && step.parts > 1)
    running->parts.emplace(Parts{.last = step, .stepped = std::vector<bool>(shard.slots())});
  if (running->extends_trial) {
    running->run = shard.prepare_extension(rows, *running->operators, columns, member.parts->stepped);
  } else if (step.policy == wire::Policy::kAllOrNothing) {
    running->run = shard.prepare_attempt(rows, *running->operators, columns, commits);
  } else {
    running->run = shard.prepare(rows, *running->operators, columns, std::move(running->run));
    journal(arrival, member.id, &member);
    // Nothing can fail from here to the answer, so states, sequence and kept reply stay consistent.
    if (commits) shard.commit();
  }
  shard.begin(*running->run);
  return running;
}

// Computes the next slice of the session's step. Returns whether the step is complete.
bool Service::slice(Member& member) {
  RunningStep& running = *member.running;
  const std::uint64_t started_ns = options_.now_ns();
  const double work = options_.slice_work > 0.0 ? options_.slice_work : std::numeric_limits<double>::infinity();
  running.done = member.shard->work(*running.run, work);
  running.ended_ns = options_.now_ns();
  running.solver_ns += running.ended_ns - started_ns;
  member.last_request_ns = running.ended_ns;  // a client is not idle while it waits
  return running.done;
}

bool Service::work() noexcept {
  const bool ended = resume_long();
  if (computing_.empty()) return ended;
  const Longest measured(options_.cpu_ns, metrics_.longest_turn_ns);
  // The turn is the user's who has had the least time, and of this user's sessions the one that waits longest.
  const auto next = std::ranges::min_element(
      computing_, {}, [&](const Member* waiting) { return users_.find(waiting->identity)->second.turn_ns; });
  Member& member = **next;
  computing_.erase(next);
  const std::uint64_t started_ns = options_.now_ns();
  try {
    const bool complete = slice(member);
    users_.find(member.identity)->second.turn_ns += options_.now_ns() - started_ns;
    if (complete) {
      computed_.push_back(&member);
      return true;
    }
    computing_.push_back(&member);
    return ended;
  } catch (const std::exception& fault) {
    // A journaled request has not run: states and journal differ. Another one is asked again and begins anew.
    failed_ = failed_ || member.running->journaled;
    std::erase(journaled_, &member);
    if (member.running->pending) member.running->pending->copy();
    member.running.reset();
    log(std::string("ALARM: a step could not be computed: ") + fault.what());
    return true;
  }
}

// Completes the reply with what the host should know of the step. The step has run: without memory for a warning the
// reply goes without it.
void Service::report(const shard::Shard& shard, const RunningStep& running,
                     const shard::StepCount& count) const noexcept try {
  auto& upscale = std::get<wire::Upscale>(running.reply->body);
  if (shard.check_closure()) {
    report_closure(shard, running.step(), running.request.batch, running.rows, count.closure, upscale);
    report_layers(shard, running.request.batch, running.rows, upscale);
  }
  if (count.over_budget == 0) return;
  upscale.warnings.push_back(fmt::format(
      "outcome: {} needed more than the scene's work_budget of {:g} evaluations in this step, with states unchanged "
      "(outcome 144). Take a shorter step or a larger tolerance, or open the session with a "
      "larger work_budget; this server grants up to {:g}",
      wire::counted(count.over_budget, "node"), shard.model().options().work_budget, options_.max_work_budget));
} catch (const std::exception&) {
}

// Changes the states and completes the answer. `arrival` is the request as it has been asked last.
void Service::end_step(Member& member, RunningStep& running, const Arrival& arrival) {
  shard::Shard& shard = *member.shard;
  const wire::Downscale& step = running.step();
  const wire::Batch& batch = running.request.batch;
  const shard::Rows& rows = running.rows;
  wire::Reply& reply = *running.reply;
  current_.started_ns = running.started_ns;
  const shard::StepCount count = shard::Shard::count_of(*running.run);
  const bool all_or_nothing = step.policy == wire::Policy::kAllOrNothing;
  if (count.failed != 0) leave_capsules(member, running, all_or_nothing && step.commit_previous);
  if (all_or_nothing || running.extends_trial) {
    if (count.failed != 0 && all_or_nothing) refuse_failed_step(batch, shard.nodes(), running.outcomes());
    journal(arrival, member.id, &member, running.request.sequence);
    if (step.commit_previous) shard.commit();
  }
  shard.finish(*running.run);
  const std::size_t stepped = running.extends_trial && rows.others_are_open ? shard.nodes().size() - member.parts->nodes
                                                                            : shard.stepped_nodes(rows);
  if (running.extends_trial) running.parts = std::move(member.parts);
  if (running.parts) running.parts->add(step, rows);
  member.parts = step.part < step.parts ? std::move(running.parts) : std::nullopt;
  if (step.mode == wire::Mode::kAdvance && !member.parts) shard.commit();
  auto& upscale = std::get<wire::Upscale>(reply.body);
  report(shard, running, count);
  upscale.nodes = rows.all ? shard.nodes().size() : rows.slots.size();
  upscale.flagged_nodes = count.flagged;
  upscale.state_version = shard.state_version();
  upscale.solver_ns = running.solver_ns;
  upscale.service_ns = running.ended_ns - running.started_ns;
  recycle(member.conversation.complete(running.request.sequence, running.hash, running.reply, step.follows != 0));

  if (store_ != nullptr) store_->add_work(count.work);
  ++member.requests;
  member.node_steps += stepped;
  member.solver_ns += upscale.solver_ns;
  member.asleep_node_steps += count.asleep;
  metrics_.node_steps += stepped;
  metrics_.solver_ns += upscale.solver_ns;
  if (const auto owner = users_.find(arrival.caller.identity); owner != users_.end()) {
    owner->second.counted.node_steps += stepped;
    owner->second.counted.solver_ns += upscale.solver_ns;
  }
  times_.solver.add(upscale.solver_ns);
}

}  // namespace shearbus::service
