// What the service does with a request: one row for each verb.
#include <fmt/format.h>

#include <array>
#include <cstddef>
#include <type_traits>
#include <utility>
#include <variant>

#include "server/service/member.hpp"
#include "server/service/service.hpp"
#include "server/service/validate.hpp"
#include "server/service/verb.hpp"

namespace shearbus::service {

using wire::Code;

struct Service::Verbs {
  enum class For { kAnybody, kOperators };
  enum class Domain { kStays, kMayChange };

  template <typename Body>
  static constexpr std::size_t place() {
    return []<typename... Bodies>(const std::variant<Bodies...>*) {
      std::size_t at = 0;
      static_cast<void>(((std::is_same_v<Body, Bodies> || (++at, false)) || ...));
      return at;
    }(static_cast<const decltype(wire::Request::body)*>(nullptr));
  }

  // A verb without a sequence number, which finds the session it concerns itself, if any.
  template <typename Body, ReplyPtr (Service::*kHandler)(const Body&, Arrival&, const ReplyPtr&)>
  static constexpr Verb aside(For whom = For::kAnybody) {
    return {.body = place<Body>(),
            .of_operators = whom == For::kOperators,
            .handler = [](Service& service, const Verb&, Member*, Arrival& arrival, const ReplyPtr& reply) {
              return (service.*kHandler)(std::get<Body>(arrival.request.body), arrival, reply);
            }};
  }

  // The next request of a session, which is journaled and whose reply is kept.
  template <typename Body, void (Service::*kHandler)(Member&, const Body&, const Arrival&, wire::Reply&)>
  static constexpr Verb next(Trial trial, Domain domain = Domain::kMayChange) {
    return {.body = place<Body>(),
            .sequence = true,
            .trial = trial,
            .changes_domain = domain == Domain::kMayChange,
            .handler = [](Service& service, const Verb& verb, Member* member, Arrival& arrival, const ReplyPtr& reply) {
              if (!service.begin_change(verb, *member)) return reply;
              (service.*kHandler)(*member, std::get<Body>(arrival.request.body), arrival, *reply);
              service.end_change(*member, arrival, reply);
              return reply;
            }};
  }

  static constexpr Verb step() {
    return {.body = place<wire::Downscale>(),
            .sequence = true,
            .handler = [](Service& service, const Verb&, Member* member, Arrival& arrival, const ReplyPtr& reply) {
              return service.downscale(*member, arrival, reply);
            }};
  }

  static constexpr auto all() {
    constexpr std::array kRows = {
        aside<wire::Hello, &Service::hello>(),
        aside<wire::ServerStatusQuery, &Service::tell_status>(),
        aside<wire::Inspect, &Service::inspect>(For::kOperators),
        aside<wire::Checkpoint, &Service::checkpoint_now>(For::kOperators),
        aside<wire::Drain, &Service::drain>(For::kOperators),
        aside<wire::OpenSession, &Service::open_session>(),
        aside<wire::ResumeSession, &Service::resume>(),
        aside<wire::ReadProfiles, &Service::read_profiles>(),
        step(),
        next<wire::Commit, &Service::commit>(Trial::kMustStand, Domain::kStays),
        next<wire::Rollback, &Service::rollback>(Trial::kAny),
        next<wire::Mark, &Service::mark>(Trial::kAny),
        next<wire::RegisterNodes, &Service::register_nodes>(Trial::kMustNotStand),
        next<wire::RetireNodes, &Service::retire_nodes>(Trial::kMustNotStand),
        next<wire::OfferNodes, &Service::offer_nodes>(Trial::kMustNotStand),
        next<wire::AcceptNodes, &Service::accept_nodes>(Trial::kMustNotStand),
        next<wire::CloseSession, &Service::close_session>(Trial::kAny),
    };
    std::array<Verb, Metrics::kVerbs> by_body{};
    for (const Verb& verb : kRows) by_body[verb.body] = verb;
    return by_body;
  }
};

const Service::Verb& Service::verb_of(const wire::Request& request) {
  static constexpr std::array kVerbs = Verbs::all();
  static_assert(
      [] {
        for (std::size_t body = 1; body < kVerbs.size(); ++body)
          if (kVerbs[body].body != body) return false;
        return true;
      }(),
      "a verb has no row");
  return kVerbs[request.body.index()];  // decode() accepts no request without a body
}

// Returns false if the request must wait.
bool Service::begin_change(const Verb& verb, Member& member) {
  if (must_wait(member)) return false;
  if (verb.changes_domain && must_wait_for_domain(member.identity, member.domain)) return false;
  hold(member);
  if (verb.trial == Trial::kMustStand && !member.trial_stands())
    refuse(Code::kNothingToCommit, "",
           member.parts ? fmt::format("parts of the step are missing: {} of {} have come", member.parts->last.part,
                                      member.parts->last.parts)
                        : "no trial is standing",
           "Send a trial step first, with all of its parts.");
  if (verb.trial == Trial::kMustNotStand && member.shard->has_trial())
    refuse(Code::kTrialStands, "", "a trial stands; its states are of the nodes there are",
           "Commit it or roll it back, then change the set of nodes.");
  return true;
}

void Service::end_change(Member& member, const Arrival& arrival, const ReplyPtr& reply) {
  ++member.requests;
  recycle(member.conversation.complete(arrival.request.sequence, arrival.hash, reply));
}

}  // namespace shearbus::service
