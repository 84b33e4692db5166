// One DEALER socket with deadlines and retries: sends a request to the server and receives the reply to it.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "client/src/options.hpp"
#include "proto/files/key_file.hpp"
#include "proto/files/session_recorder.hpp"
#include "proto/wire/codec.hpp"
#include "proto/wire/messages.hpp"

namespace shearbus {

// Returns the name of a request in the protocol, for instance "downscale"; empty for a request without a body.
const char* verb_of(const wire::Request& request);

// The interface between a session and its server. The production implementation uses a socket; tests use other
// implementations.
class Connection {
 public:
  using Clock = std::chrono::steady_clock;

  explicit Connection(ClientOptions options) : options_(std::move(options)) {}
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;
  virtual ~Connection() = default;

  // Sends `request` and waits for its reply; repeats the same bytes on a fresh socket after every `retry_after` without
  // a reply. Throws Error: the status of the reply if that is not OK, kUnreachable if the request was never sent, kAuth
  // when the server refuses the connection, kUnknownOutcome if the request was sent and no reply came before the
  // deadline.
  virtual Received call(const wire::Request& request, std::chrono::milliseconds deadline) = 0;

  // Sends `request` if that is possible without waiting. The caller must then call() the same request, which only waits
  // for the reply.
  virtual void post(const wire::Request& /*request*/) {}

  // Sends `request`, too, behind the one that was posted last and has no reply yet, if that is possible without waiting.
  // The caller must then call() both, in this order.
  virtual void post_behind(const wire::Request& /*request*/) {}

  // Sends `request` if that is possible without waiting; nobody reads its reply.
  virtual void say(const wire::Request& request) noexcept = 0;

  virtual Clock::time_point now() const { return Clock::now(); }
  virtual void pause(std::chrono::milliseconds time);

  // Time left until the deadline of a call that began at `started`; a call may consist of several exchanges.
  std::chrono::milliseconds left_since(Clock::time_point started) const;

  const ClientOptions& options() const { return options_; }
  void set_reply_deadline(std::chrono::milliseconds deadline) { options_.reply_deadline = deadline; }
  std::uint64_t next_request_id();  // never 0
  std::uint64_t claimant() {
    return claimant_ != 0 ? claimant_ : claimant_ = next_request_id();
  }  // random number of this client

  // The last opening request that gave no session: its outcome is unknown, or it was refused and a late copy may still
  // succeed (for example when the disk has space again). A repeated opening must have the same bytes, so that one
  // session owns the nodes.
  std::optional<wire::Request> opening_in_doubt;
  bool opening_undone = false;  // the last opening was refused, and its ids cannot be used again

  // Whether headers hold the sums of payloads. Messages to a server of this process go without, unless they are recorded.
  wire::PayloadSum payload_sum() const { return payload_sum_; }

  // Most rows of a step or of one of its parts, as the server's welcome says.
  std::size_t max_rows() const { return max_rows_; }
  void set_max_rows(std::uint64_t rows) { max_rows_ = rows != 0 ? rows : wire::kMaxRowsPerMessage; }
  bool durable() const { return durable_; }  // true if the welcome says that sessions outlive the server
  // True if the welcome says that a part of a step may be sent before the part before it is answered.
  bool parts_ahead() const { return parts_ahead_; }
  void heed(const wire::Welcome& welcome);

 protected:
  void leave_out_payload_sums() { payload_sum_ = wire::PayloadSum::kLeftOut; }

 private:
  ClientOptions options_;
  wire::PayloadSum payload_sum_ = wire::PayloadSum::kGiven;
  std::uint64_t last_request_id_ = 0;  // 0: no first id has been chosen yet
  std::uint64_t claimant_ = 0;
  bool durable_ = false;
  bool parts_ahead_ = false;
  std::size_t max_rows_ = wire::kMaxRowsPerMessage;
};

class SocketConnection final : public Connection {
 public:
  explicit SocketConnection(ClientOptions options);
  ~SocketConnection() override;

  Received call(const wire::Request& request, std::chrono::milliseconds deadline) override;
  void post(const wire::Request& request) override;
  void post_behind(const wire::Request& request) override;
  void say(const wire::Request& request) noexcept override;

 private:
  struct Posted {
    std::uint64_t request_id;
    Clock::time_point at;
  };
  struct CloseSocket {
    void operator()(void* socket) const;
  };
  struct CloseContext {
    void operator()(void* context) const;
  };

  // Times of the notices that ClientOptions::log, or standard error, gets while a call waits.
  struct Waiting {
    Clock::time_point since;
    Clock::time_point next_notice;
    const char* verb;
  };

  void start_recording();
  void record(const std::string& header, const wire::Batch& batch, std::span<const std::byte> reply_header = {},
              std::span<const std::byte> reply_payload = {}) noexcept;
  bool by_file() const;
  bool in_process() const;
  bool find_server();
  void drop_socket();
  bool server_has_moved() const;
  void* context();
  void* new_socket(int type, const char* kind);
  [[noreturn]] void no_socket(const char* kind) const;
  bool connect();
  void watch_handshakes();
  std::string own_public_key() const;
  bool wait(short events, Clock::time_point until);
  std::pair<bool, bool> sleep(short events, long wait_ms);
  std::chrono::seconds first_notice() const;
  void notice(short events);
  bool host_ends_call();
  void look();
  bool send(const std::string& header, const wire::Batch& batch);
  void read_handshakes();
  Received exchange(const wire::Request& request, std::chrono::milliseconds deadline);
  bool receive(std::uint64_t request_id, Clock::time_point until, Received& received);
  void handshake_failed(int event, std::uint32_t detail);
  void recovering(const wire::Status& status);
  [[noreturn]] void refused(bool sent) const;
  [[noreturn]] void give_up(bool sent, Clock::duration waited) const;

  files::ServerAddress server_;  // where socket_ connects to, from the options or from the endpoint file
  std::string where_;            // the same for messages
  std::string file_epoch_;       // epoch in the endpoint file when socket_ was made
  std::string file_fault_;       // why the endpoint file cannot be used; empty: it can, or there is none
  std::unique_ptr<void, CloseContext> own_context_;  // null if the caller shares a context
  std::optional<files::SessionRecorder> recorder_;
  std::shared_ptr<void> reply_header_frame_;  // of the last reply; only for the recorder
  std::string header_;                        // of the last request
  std::optional<Posted> posted_;
  std::optional<Posted> behind_;  // sent behind the request that is posted or called
  Waiting waiting_{};
  bool answered_ = false;                       // true once the server has answered
  std::unique_ptr<void, CloseSocket> monitor_;  // receives the handshake events of socket_
  std::unique_ptr<void, CloseSocket>
      socket_;     // null after a timeout, so that a late reply cannot be mistaken for another
  int file_ = -1;  // of socket_, and of monitor_; libzmq makes it readable when it has something to tell
  int monitor_file_ = -1;
  bool monitor_unread_ = false;  // events may wait in monitor_ of which its file does not tell
  wire::Status refusal_;         // why the server refused the connection; OK if it did not
  int frames_read_ = 0;          // frames read from socket_ since it was found empty
  int silent_failures_ = 0;      // consecutive handshakes that failed without a reason
};

}  // namespace shearbus
