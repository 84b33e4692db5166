// Internal to the client library: one session of a Session that is held by several servers, its shards. Each request of
// the Session becomes a request to every shard that it concerns, sent to all at once; the replies are joined. A request
// that some shards have run and others have not yet answered is an operation under way. The same request resumes it; any
// other completes it first.
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "client/src/session.hpp"

namespace shearbus {

// The connections to the shards, and the deadline that their requests of one call share.
class ShardLinks {
 public:
  explicit ShardLinks(std::vector<std::shared_ptr<Connection>> shards) : shards_(std::move(shards)) {}
  std::uint32_t size() const { return static_cast<std::uint32_t>(shards_.size()); }
  const std::shared_ptr<Connection>& operator[](std::uint32_t shard) const { return shards_[shard]; }
  void begin_call(std::chrono::milliseconds deadline);
  // Time left to the call for a request to this shard, at least 1 ms; also set as the shard's reply deadline.
  std::chrono::milliseconds left(std::uint32_t shard) const;

 private:
  std::vector<std::shared_ptr<Connection>> shards_;
  std::vector<Connection::Clock::time_point> started_;  // each by the clock of its shard
  std::chrono::milliseconds deadline_{0};
};

// Sends the request without waiting, if that is possible; the call that follows sends it otherwise. `post`: how, where it
// goes behind a request that is not answered yet.
void try_post(Connection& connection, const wire::Request& request,
              void (Connection::*post)(const wire::Request&) = &Connection::post) noexcept;

// Rows of each shard, for rows that belong to these nodes.
std::vector<std::vector<std::uint32_t>> rows_of_shards(std::span<const std::uint64_t> node_ids, std::uint32_t shards);

// Copies some rows of the columns of a request. Throws Error{kShape} if columns differ in length or lack a component.
Batch rows_of(const Batch& batch, std::span<const std::uint32_t> rows);

// Throws the Error of a call that cannot be made.
[[noreturn]] void refuse_call(Code code, std::string text, std::string remedy, Field field = Field::kUnspecified,
                              std::vector<std::uint64_t> node_ids = {});

// Refuses a request of a kind that only one server can answer.
[[noreturn]] void refuse_verb(const wire::Request& request);

inline bool last_of_step(const wire::Downscale& step) {
  return step.part == step.parts;
}

class ShardedSession {
 public:
  // `shards`: the sessions in the order of the shards, with their nodes; resumed, or to be opened by the first request.
  // `node_ids`: the order of the rows; empty: ascending in the ids if each shard has its nodes in ascending order.
  ShardedSession(ShardLinks& links, std::vector<std::unique_ptr<SessionState>> shards,
                 std::vector<std::uint64_t> node_ids);

  Received call(const wire::Request& request);
  bool under_way() const { return operation_.has_value(); }  // after a fault: whether the same call goes on
  Received read_profiles(const wire::Request& request);
  void post(const wire::Request& request);
  // Sends a part of a step to the shards before they have answered the part before it.
  void post_behind(const wire::Request& request);
  void say_close(const wire::Request& request) noexcept;
  Received close(const wire::Request& request);

  // After resuming: brings all shards to the same step. Of a commit that only some shards have run, the others run it
  // now; a trial that does not stand on all shards is rolled back.
  void reconcile(std::span<const wire::SessionResumed> positions);
  wire::SessionResumed position() const;
  // Joins the columns of nodes of the replies to the resumption, one per shard, in the order of node_ids().
  Batch join_nodes(std::span<const Received> replies) const;
  const std::vector<std::uint64_t>& node_ids() const { return *node_ids_; }

 private:
  using Ids = std::vector<std::uint64_t>;
  using Body = decltype(wire::Request::body);
  struct Shard {
    std::unique_ptr<SessionState> session;
    std::vector<std::uint32_t> rows;            // row of each of its nodes, in the order of the shard's session
    std::optional<wire::SessionClosed> closed;  // what it has answered to the closing request
  };
  struct Asked {                            // of a shard, in an operation
    std::vector<std::uint32_t> named_rows;  // the shard's rows of a request that names its nodes
    wire::Request request;                  // the last one
    bool open = false;                      // it has no answer yet
    std::optional<Received> reply;          // to the last request
    std::optional<Received> answer;         // to the step, while the requests that follow are made
    std::optional<Error> refusal;
    bool ran_part = false;  // it has run the part that others have refused, and may run the part behind it
  };
  enum class Stage { kDropTrial, kAsked, kDrain, kCommit, kCommitPrevious, kUndo };
  struct Operation {
    std::uint64_t hash = 0;
    std::uint64_t sequence = 0;
    wire::Request question;  // without the columns of a step
    std::size_t rows = 0;
    bool named = false;
    bool commits_previous = false;
    Stage stage = Stage::kAsked;
    std::optional<Error> refusal;
    std::vector<Asked> asked;  // of each shard
  };
  // The rows that a shard has answered, and their places in the order of the host.
  struct Answered {
    std::size_t shard;
    const Batch& columns;
    std::span<const std::uint32_t> places;
  };

  void begin(const wire::Request& request, std::uint64_t hash);
  Operation operation_of(const wire::Request& request, std::uint64_t hash) const;
  void begin_ahead();
  void settle_ahead();
  void drain();
  void undo();
  void begin_opening(const wire::Request& request, const wire::OpenSession& opening);
  void begin_step(const wire::Request& request, const wire::Downscale& step);
  void ask_to_roll_back(const wire::Rollback& rollback);
  void begin_nodes(const wire::Request& request, bool leaving);
  Received complete();
  void ask(std::size_t shard, Body body, Batch batch = {});
  void ask_all(const Body& body);
  void post_all();
  void settle();
  bool go_on();
  void go_back();
  Received join();
  void join_step(const wire::Downscale& step, Received& joined);
  static Batch join_rows(std::span<const Answered> answers, std::size_t rows, std::size_t values_per_row = 1);
  bool place(std::shared_ptr<const Ids> order);
  Ids merged() const;
  bool agree(std::span<const std::uint64_t> versions);
  [[noreturn]] void refuse_torn() const;
  template <typename Answer>
  std::uint64_t version_of_all();
  std::span<const std::uint32_t> rows_in(const Operation& step, std::size_t shard) const {
    return step.named ? step.asked[shard].named_rows : shards_[shard].rows;
  }

  ShardLinks& links_;
  std::vector<Shard> shards_;
  std::shared_ptr<const Ids> node_ids_;
  std::map<std::string, std::shared_ptr<const Ids>> marks_;  // order of the rows at each mark
  std::optional<Operation> operation_;
  std::optional<Operation> ahead_;  // a part that was sent behind the part under way, or behind the last one
  std::uint64_t last_sequence_ = 0;
  std::uint64_t state_version_ = 0;
  bool trial_stands_ = false;
  // A step was refused after it had committed the trial before: its repetition must not commit again.
  bool previous_committed_ = false;
  std::string torn_;  // why the shards are not at the same step; empty: they are
};

}  // namespace shearbus
