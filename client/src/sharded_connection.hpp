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
  // An opening that has not ended. A repetition asks only the shards that have not answered.
  struct Opening {
    struct OfShard {
      wire::Request request;
      std::optional<Received> opened;
      std::optional<Error> refused;
    };
    wire::SessionId id{};
    std::uint64_t hash = 0;
    std::vector<OfShard> shards;
  };

  Received hello(const wire::Request& request);
  Received open(const wire::Request& request);
  void begin_opening(const wire::Request& request, std::uint64_t hash);
  void undo_opening() noexcept;
  Received resume(const wire::Request& request);
  ShardedSession& session_of(const wire::Request& request);

  ShardLinks links_;
  std::optional<Opening> opening_;
  std::map<wire::SessionId, std::unique_ptr<ShardedSession>> sessions_;
};

}  // namespace shearbus
