// A simple stand-in for a server on a store. Its state is the list of the requests that it has received.
#pragma once

#include <gtest/gtest.h>

#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "server/store/store.hpp"
#include "tests/support/memory_storage.hpp"

namespace shearbus::store {

using support::MemoryStorage;

inline std::vector<std::byte> bytes_of(std::uint64_t value) {
  std::vector<std::byte> bytes(64);
  std::memcpy(bytes.data(), &value, sizeof value);
  return bytes;
}
inline std::uint64_t value_of(Bytes bytes) {
  std::uint64_t value = 0;
  std::memcpy(&value, bytes.data(), sizeof value);
  return value;
}

inline bool write_checkpoint(Store& store, Snapshot snapshot) {
  const auto job = store.begin_checkpoint(std::move(snapshot));
  store.write(*job);
  return store.end_checkpoint(*job);
}

struct Counter final : Recovery {
  void restore(const Snapshot& snapshot) override {
    seen.clear();
    for (const std::uint64_t value : snapshot.sessions.at(0).node_ids) seen.push_back(value);
  }
  void replay(const Record& record, std::uint64_t epoch) override {
    EXPECT_NE(epoch, 0u);
    seen.push_back(value_of(record.header_frame));
  }
  void clear() override { seen.clear(); }
  Snapshot snapshot() const {
    SessionImage session;
    session.scene = "-";
    session.node_ids = seen;
    for (std::uint32_t row = 0; row < seen.size(); ++row) session.committed.rows.push_back(row);
    return {.server_version = "test", .sessions = {session}};
  }
  std::vector<std::uint64_t> seen;
};

struct Server {
  explicit Server(MemoryStorage& disk, Durability durability = Durability::kPower, bool accept_empty = false,
                  std::uint8_t id = 1)
      : store(disk, {.durability = durability,
                     .epoch = 5,
                     .fresh_id = {id},
                     .accept_empty = accept_empty,
                     .log = [this](const std::string& line) { log += line + "\n"; }}) {
    store.recover(counter);
  }
  // Writes a request to the journal and makes it durable. Throws if the request must not be answered.
  void run(std::uint64_t value) {
    append(value);
    store.settle();
  }
  void append(std::uint64_t value) {
    const auto frame = bytes_of(value);
    store.append({.sequence = value, .header_frame = frame});
    counter.seen.push_back(value);
  }
  // Runs the requests that follow up to `last`, with a checkpoint after every `each` of them; 0: none.
  void run_to(std::uint64_t last, std::uint64_t each = 0) {
    for (std::uint64_t i = counter.seen.size() + 1; i <= last; ++i) {
      run(i);
      EXPECT_TRUE(each == 0 || i % each != 0 || checkpoint());
    }
  }
  bool checkpoint() { return write_checkpoint(store, counter.snapshot()); }

  std::string log;
  Counter counter;
  Store store;
};

inline std::vector<std::uint64_t> up_to(std::uint64_t last) {
  std::vector<std::uint64_t> values;
  for (std::uint64_t i = 1; i <= last; ++i) values.push_back(i);
  return values;
}

}  // namespace shearbus::store
