// Internal to the client library: several servers that a Session sees as one (proto/WIRE.md, "Several servers").
#pragma once

#include <map>
#include <memory>
#include <vector>

#include "client/src/connection.hpp"
#include "client/src/sharded_session.hpp"

namespace shearbus {

// Returns the connection to the server, or the servers, that options.endpoint names.
std::shared_ptr<Connection> connect_to(ClientOptions options);

class ShardedConnection final : public Connection {
 public:
  ShardedConnection(ClientOptions options, std::vector<std::shared_ptr<Connection>> shards);

  Received call(const wire::Request& request, std::chrono::milliseconds deadline) override;
  void post(const wire::Request& request) override;
  void post_behind(const wire::Request& request) override;
  void say(const wire::Request& request) noexcept override;
  Clock::time_point now() const override { return links_[0]->now(); }
  void pause(std::chrono::milliseconds time) override { links_[0]->pause(time); }

 private:
  Received hello(const wire::Request& request);
  Received open(const wire::Request& request);
  Received resume(const wire::Request& request);
  ShardedSession& session_of(const wire::Request& request);
  // What a shard has of a session, which the host knows by this id and token.
  std::unique_ptr<SessionState> shard_of_session(std::uint32_t shard, const wire::SessionId& id,
                                                 const wire::ResumeToken& token) const;

  ShardLinks links_;
  std::map<wire::SessionId, std::unique_ptr<ShardedSession>> sessions_;
};

}  // namespace shearbus
