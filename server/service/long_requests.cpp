// Requests that are no steps and take long: openings of many nodes, marks, profiles, ... Each is a task that has its turn
// on the thread of the service, and does what is long beside it.
#include <algorithm>
#include <system_error>
#include <utility>
#include <variant>

#include "server/service/member.hpp"
#include "server/service/service.hpp"

namespace shearbus::service {

namespace {

constexpr std::size_t kMostLong = 16;  // most requests that have work aside, one of each user

// Thrown by the first long part of a request that has no thread of its own yet.
struct TakesLong {};

}  // namespace

void Service::aside(std::uint64_t bytes, const std::function<void()>& act) {
  if (bytes < options_.aside_from || (turn_of_ == nullptr && !may_step_aside_)) return act();
  if (turn_of_ == nullptr) throw TakesLong();
  LongRequest& request = *std::exchange(turn_of_, nullptr);
  request.journaled = std::exchange(journaled_now_, false);
  request.current = current_;
  request.turn.reset();
  request.task->aside(act);
  request.turn.emplace(options_.cpu_ns, metrics_.longest_turn_ns);
}

void Service::change_aside(Member& member, std::uint64_t bytes, const std::function<void()>& act) {
  if (turn_of_ == nullptr || bytes < options_.aside_from) return act();
  member.held_before = member.shard ? member.held_bytes() : 0;
  member.nodes_before = member.shard ? member.shard->nodes().size() : 0;
  member.changing = true;
  aside(bytes, act);
  member.changing = false;
}

Service::ReplyPtr Service::answer_in_turn(Arrival& arrival, const ReplyPtr& reply) {
  if (turn_of_ != nullptr) return answer_by_verb(arrival, reply);
  may_step_aside_ = may_wait_ && options_.wake;
  try {
    return answer_by_verb(arrival, reply);
  } catch (const TakesLong&) {
  }
  if (ReplyPtr begun = begin_long(arrival, reply)) return begun;
  may_step_aside_ = false;
  return answer_by_verb(arrival, reply);  // there is no thread to be had
}

// Returns null if there is no thread.
Service::ReplyPtr Service::begin_long(Arrival& arrival, const ReplyPtr& reply) {
  auto made = std::make_unique<LongRequest>();
  LongRequest& request = *made;
  request.owner = arrival.caller.identity;
  if (const auto* open = std::get_if<wire::OpenSession>(&arrival.request.body)) {
    request.opens = open->session_id;
    request.domain = open->domain;
  } else if (const auto member = members_.find(arrival.request.session_id); member != members_.end()) {
    request.owner = member->second->identity;
    request.domain = member->second->domain;
  }
  const auto of_owner = [&](const auto& other) { return other->owner == request.owner; };
  if (long_.size() >= kMostLong || std::ranges::any_of(long_, of_owner)) {
    turn_ = Turn::kWaiting;
    return reply;
  }
  long_.reserve(long_.size() + 1);
  const auto body = [this, &request] {
    request.turn.emplace(options_.cpu_ns, metrics_.longest_turn_ns);
    try {
      request.answer = answer_in_turn(request.arrival, request.reply);
    } catch (const std::exception&) {
      request.fault = std::current_exception();
    }
    request.turn.reset();
  };
  try {
    request.task = std::make_unique<shard::SideTask>(body, options_.wake);
  } catch (const std::system_error&) {
    return nullptr;
  }
  request.frames = {};
  std::ranges::copy(arrival.frames.first(std::min(arrival.frames.size(), request.frames.size())),
                    request.frames.begin());
  request.arrival = std::move(arrival);
  request.arrival.frames = Frames(request.frames).first(std::min(request.arrival.frames.size(), request.frames.size()));
  request.reply = reply;
  request.current = current_;
  long_.push_back(std::move(made));
  give_turn(request);
  if (request.task->ended() && (request.answer || request.fault)) return end_long(request);
  turn_ = Turn::kComputing;
  return reply;
}

// Lets the request go on to its next long part, or to its end.
void Service::give_turn(LongRequest& request) {
  turn_of_ = &request;
  journaled_now_ = request.journaled;
  current_ = request.current;
  may_wait_ = may_step_aside_ = false;
  turn_ = Turn::kAnswered;
  request.task->resume();
  if (!request.task->ended()) return;
  turn_of_ = nullptr;
  request.journaled = std::exchange(journaled_now_, false);
  request.current = current_;
  if (request.member != nullptr) request.member->long_request = nullptr;
  request.member = nullptr;
}

// The request with these frames that has work aside, or had.
Service::LongRequest* Service::asked_again(Frames frames) const {
  const auto found = std::ranges::find_if(
      long_, [&](const auto& request) { return !frames.empty() && request->frames[0].data() == frames[0].data(); });
  return found != long_.end() ? found->get() : nullptr;
}

// Returns the answer of a request that has ended, or throws its fault; null if it has made ready what it needs, and is to
// be answered now.
Service::ReplyPtr Service::end_long(LongRequest& request) {
  const auto at = std::ranges::find(long_, &request, [](const auto& other) { return other.get(); });
  const std::unique_ptr<LongRequest> ended = std::move(*at);
  long_.erase(at);
  journaled_now_ = ended->journaled;
  current_ = ended->current;
  if (ended->fault) std::rethrow_exception(ended->fault);
  return ended->answer;
}

bool Service::computing() const {
  return !computing_.empty() || std::ranges::any_of(long_, [](const auto& request) {
    return !request->task->ended() && request->task->wants_turn();
  });
}

bool Service::resume_long() noexcept {
  bool complete = false;
  for (const std::unique_ptr<LongRequest>& request : long_) {
    if (request->task->ended() || !request->task->wants_turn()) continue;
    give_turn(*request);
    complete = complete || request->task->ended();
  }
  return complete;
}

bool Service::changing() const {
  return std::ranges::any_of(long_, [](const auto& request) { return request->member && request->member->changing; });
}

void Service::finish_changes() noexcept {
  for (const std::unique_ptr<LongRequest>& request : long_)
    while (request->member != nullptr && request->member->changing) give_turn(*request);
}

void Service::give_up() noexcept {
  finish_changes();
  for (const std::unique_ptr<LongRequest>& request : long_)
    if (request->member != nullptr) request->member->long_request = nullptr;
  long_.clear();
  for (const Member* member : journaled_)
    if (member->running->pending) member->running->pending->copy();
}

// What looks at all sessions waits for changes of their states.
bool Service::must_wait_for_changes() {
  if (!may_wait_ || !changing()) return false;
  turn_ = Turn::kWaiting;
  return true;
}

// Remembers that the request with the turn is one of this session.
void Service::hold(Member& member) {
  if (turn_of_ == nullptr) return;
  turn_of_->member = &member;
  member.long_request = turn_of_;
}

// While a step is computed or a request has work aside, every other request of its session waits.
bool Service::must_wait(const Member& member) {
  return wait_while(member.running || (member.long_request != nullptr && member.long_request != turn_of_),
                    "a request of the session is being worked on");
}

// While a request changes the nodes of a domain, every other request that does waits.
bool Service::must_wait_for_domain(std::string_view identity, std::string_view domain) {
  const auto changes_it = [&](const auto& request) {
    return request.get() != turn_of_ && request->owner == identity && request->domain == domain;
  };
  return wait_while(!domain.empty() && std::ranges::any_of(long_, changes_it),
                    "the nodes of the domain are being changed");
}

// Returns whether the present request must wait, if another one is `busy`.
bool Service::wait_while(bool busy, const char* fault) {
  if (!busy) return false;
  if (!may_wait_) throw wire::Error({.code = wire::Code::kInternal, .text = fault});
  turn_ = Turn::kWaiting;
  return true;
}

}  // namespace shearbus::service
