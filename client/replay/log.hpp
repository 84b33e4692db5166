// An event log as what was asked and answered, without what a replay cannot or need not repeat.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "client/replay/names.hpp"
#include "proto/files/event_log.hpp"
#include "proto/wire/messages.hpp"

namespace shearbus::replay {

// The exchanges of a log that changed the session, and refusals that its states or the content of the request explain.
// Left out: requests without a reply, repetitions of a request, resume_session, and refusals that the server or the
// network explain.
class Log {
 public:
  explicit Log(const std::filesystem::path& file);

  const files::EventLogHead& head() const { return reader_.head(); }
  const std::string& name() const { return name_; }
  // Reads the next exchange. Returns false at the end. Throws Error if the log lacks a request that was accepted.
  bool next();
  // The exchange, valid until the next call.
  const wire::Request& request() const { return request_; }
  const wire::Reply& reply() const { return reply_; }
  std::uint64_t index() const { return reader_.index(); }
  std::uint64_t time_ns() const { return reader_.time_ns(); }
  std::uint64_t left_out() const { return left_out_; }  // refusals left out so far
  bool torn() const { return reader_.torn(); }

 private:
  std::string name_;
  files::EventLogReader reader_;
  wire::Request request_;
  wire::Reply reply_;
  std::uint64_t expected_ = 0;  // sequence number of the next accepted request
  std::uint64_t left_out_ = 0;
};

// The ids of a session's nodes in the order of the rows of a step that names none.
class NodeOrder {
 public:
  void follow(const wire::Request& request, const wire::Reply& reply);
  const std::vector<std::uint64_t>& ids() const { return ids_; }
  // The ids of the rows of a step.
  std::span<const std::uint64_t> rows_of(const wire::Request& step) const;

 private:
  std::vector<std::uint64_t> ids_;
};

}  // namespace shearbus::replay
