#include "client/src/sharded_connection.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <set>
#include <utility>
#include <variant>

#include "client/src/shards.hpp"

namespace shearbus {
namespace {

// The weakest of the servers is the durability of a session over all of them.
int rank_of(const std::string& durability) {
  return durability == "power" ? 2 : durability == "process" ? 1 : 0;
}

// The welcome of all servers together.
void join(wire::Welcome& all, const wire::Welcome& one) {
  if (rank_of(one.durability) < rank_of(all.durability)) all.durability = one.durability;
  std::erase_if(all.capabilities, [&](const std::string& word) {
    return std::ranges::find(one.capabilities, word) == one.capabilities.end();
  });
  const auto least = [&](auto member) { all.limits.*member = std::min(all.limits.*member, one.limits.*member); };
  using L = wire::Limits;
  for (const auto member :
       {&L::max_header_bytes, &L::max_payload_bytes, &L::max_nodes_per_session, &L::max_sessions, &L::max_marks,
        &L::max_frames, &L::max_state_bytes, &L::max_work_budget, &L::max_replay_work, &L::max_rows_per_message,
        &L::max_sessions_per_user, &L::max_state_bytes_per_user})
    least(member);
}

}  // namespace

std::shared_ptr<Connection> connect_to(ClientOptions options) {
  const std::vector<std::string> endpoints = endpoints_in(options.endpoint);
  if (endpoints.size() == 1) {
    options.endpoint = endpoints.front();
    return std::make_shared<SocketConnection>(std::move(options));
  }
  std::vector<std::shared_ptr<Connection>> shards;
  std::error_code no_directory;
  const bool one_record = !options.record.empty() && !options.record.ends_with('/') &&
                          !std::filesystem::is_directory(options.record, no_directory);
  for (const std::string& endpoint : endpoints) {
    ClientOptions of_shard = options;
    of_shard.endpoint = endpoint;
    if (one_record) of_shard.record += fmt::format(".{}", shards.size());
    shards.push_back(std::make_shared<SocketConnection>(std::move(of_shard)));
  }
  return std::make_shared<ShardedConnection>(std::move(options), std::move(shards));
}

ShardedConnection::ShardedConnection(ClientOptions options, std::vector<std::shared_ptr<Connection>> shards)
    : Connection(std::move(options)), links_(std::move(shards)) {}

Received ShardedConnection::call(const wire::Request& request, std::chrono::milliseconds deadline) {
  links_.begin_call(deadline);
  if (asks<wire::Hello>(request)) return hello(request);
  if (asks<wire::OpenSession>(request)) return open(request);
  if (const auto* resumed = std::get_if<wire::ResumeSession>(&request.body)) {
    if (resumed->claim != 0) return resume(request);
    Received received;  // the position that this client knows; of another session, nothing: the claim brings it
    const auto known = sessions_.find(request.session_id);
    received.reply.body = known == sessions_.end() ? wire::SessionResumed{} : known->second->position();
    if (known != sessions_.end()) received.reply.batch = named_nodes(known->second->node_ids());
    return received;
  }
  if (asks<wire::CloseSession>(request) && sessions_.contains(request.session_id)) {
    Received received = sessions_.at(request.session_id)->close(request);
    sessions_.erase(request.session_id);
    return received;
  }
  if (asks<wire::ReadProfiles>(request)) return session_of(request).read_profiles(request);
  return session_of(request).call(request);
}

void ShardedConnection::post(const wire::Request& request) {
  session_of(request).post(request);
}

void ShardedConnection::post_behind(const wire::Request& request) {
  session_of(request).post_behind(request);
}

void ShardedConnection::say(const wire::Request& request) noexcept {
  const auto known = sessions_.find(request.session_id);
  if (known == sessions_.end()) return;
  known->second->say_close(request);
  sessions_.erase(known);
}

ShardedSession& ShardedConnection::session_of(const wire::Request& request) {
  const auto known = sessions_.find(request.session_id);
  if (known == sessions_.end()) refuse_verb(request);
  return *known->second;
}

Received ShardedConnection::hello(const wire::Request& request) {
  std::vector<wire::Request> requests;
  for (std::uint32_t k = 0; k < links_.size(); ++k) {
    requests.push_back({.request_id = links_[k]->next_request_id(), .body = request.body});
    try_post(*links_[k], requests.back());
  }
  Received joined;
  std::set<std::uint64_t> epochs;
  for (std::uint32_t k = 0; k < links_.size(); ++k) {
    Received received = links_[k]->call(requests[k], links_.left(k));
    auto& welcome = body_of<wire::Welcome>(received);
    const auto refuse = [&](Code code, std::string text, std::string remedy) {
      throw Error({.code = code,
                   .text = fmt::format("{} {}", links_[k]->options().endpoint, text),
                   .remedy = std::move(remedy),
                   .field = "endpoint"});
    };
    if (!epochs.insert(received.reply.epoch).second)
      refuse(Code::kInvalidValue, "is a server that another endpoint of the list names, too",
             "Give the endpoint of each server once.");
    links_[k]->heed(welcome);
    if (k == 0) {
      joined.reply.body = std::move(welcome);
      continue;
    }
    auto& all = std::get<wire::Welcome>(joined.reply.body);
    if (welcome.server_version != all.server_version)
      refuse(Code::kVersion,
             fmt::format("is a server of version {}, and {} one of {}", welcome.server_version,
                         links_[0]->options().endpoint, all.server_version),
             "Start all servers of a run from the same version: others may answer with other bits.");
    join(all, welcome);
  }
  return joined;
}

std::unique_ptr<SessionState> ShardedConnection::shard_of_session(std::uint32_t shard, const wire::SessionId& id,
                                                                  const wire::ResumeToken& token) const {
  auto session = std::make_unique<SessionState>();
  session->connection = links_[shard];
  session->id = session_of_shard(id, shard, links_.size());
  session->resume_token = token;
  return session;
}

// An opening whose outcome is unknown leaves its session, under the same id, to the repetition of the call.
Received ShardedConnection::open(const wire::Request& request) {
  const auto& asked = std::get<wire::OpenSession>(request.body);
  if (!sessions_.contains(asked.session_id)) {
    const auto ids = request.batch.u64(Field::kNodeId);
    const auto rows = rows_of_shards(ids, links_.size());
    std::vector<std::unique_ptr<SessionState>> shards;
    for (std::uint32_t k = 0; k < links_.size(); ++k) {
      shards.push_back(shard_of_session(k, asked.session_id, asked.resume_token));
      for (const std::uint32_t row : rows[k]) shards.back()->node_ids.push_back(ids[row]);
    }
    sessions_[asked.session_id] =
        std::make_unique<ShardedSession>(links_, std::move(shards), std::vector<std::uint64_t>(ids.begin(), ids.end()));
  }
  ShardedSession& session = *sessions_.at(asked.session_id);
  try {
    return session.call(request);
  } catch (const Error&) {
    opening_undone = !session.under_way();
    if (opening_undone) sessions_.erase(asked.session_id);
    throw;
  }
}

Received ShardedConnection::resume(const wire::Request& request) {
  const auto& asked = std::get<wire::ResumeSession>(request.body);
  std::vector<std::unique_ptr<SessionState>> sessions;
  std::vector<wire::SessionResumed> positions;
  std::vector<Received> replies;
  for (std::uint32_t k = 0; k < links_.size(); ++k) {
    auto& session = *sessions.emplace_back(shard_of_session(k, request.session_id, asked.resume_token));
    links_.left(k);
    try {
      Received where = claim_session(*links_[k], session.id, session.resume_token, session.claim_in_doubt);
      positions.push_back(body_of<wire::SessionResumed>(where));
      session.epoch = where.reply.epoch;
      session.adopt_position(where);
      replies.push_back(std::move(where));
    } catch (const Error& fault) {
      if (fault.status().code != Code::kUnknownSession) throw;
      wire::Status status = fault.status();
      status.text = fmt::format("{} does not have shard {} of {} of this session: {}", links_[k]->options().endpoint, k,
                                links_.size(), status.text);
      status.remedy = "Resume a session with the endpoints that it was opened with, all of them, in the same order.";
      throw Error(std::move(status));
    }
  }
  auto session = std::make_unique<ShardedSession>(links_, std::move(sessions), std::vector<std::uint64_t>());
  session->reconcile(positions);
  Received joined;
  auto& resumed = joined.reply.body.emplace<wire::SessionResumed>(session->position());
  resumed.session = std::move(positions.front().session);
  resumed.claim = asked.claim;
  joined.reply.batch = session->join_nodes(replies);
  sessions_[request.session_id] = std::move(session);
  return joined;
}

}  // namespace shearbus
