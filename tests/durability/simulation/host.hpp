// A host of the simulation. It steps its session and changes its nodes at random. Each answered call is repeated on a
// reference service, whose answers must have the same bits.
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <memory>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "tests/durability/simulation/connections.hpp"
#include "tests/support/refused.hpp"
#include "tests/support/scenes.hpp"

namespace shearbus::simulation {

using wire::Strategy;

// The nodes that must exist in a domain, and the offers of nodes from one session to another. The simulated server and
// the reference server give the same offer different ids.
struct Ledger {
  struct Offer {
    unsigned giver;
    TransferId transfer;
    TransferId of_reference;
    std::vector<std::uint64_t> nodes;
    bool waits = true;  // the offer is neither accepted nor withdrawn
  };
  std::multiset<std::uint64_t> nodes;
  std::vector<std::uint64_t> free;  // ids of retired nodes, which may be registered again
  std::vector<Offer> offers;
  std::uint64_t next_id = 1000;

  void add(std::span<const std::uint64_t> ids) { nodes.insert(ids.begin(), ids.end()); }
  void drop(std::span<const std::uint64_t> ids) {
    for (const std::uint64_t id : ids) ASSERT_EQ(nodes.erase(id), 1u) << "node " << id;
  }
};

class Host {
 public:
  // rows: a step of more nodes is sent in parts, one of them ahead.
  Host(World& world, Tally& tally, Ledger& ledger, support::ServiceHarness& reference, unsigned number,
       Strategy strategy, std::size_t rows);

  void act();
  const std::vector<std::uint64_t>& nodes() const { return session_.node_ids; }
  std::uint64_t nodes_of_server();
  void close();

 private:
  const StepResult& made(Session& session, const Batch& columns, wire::Mode mode, bool commit_previous);
  void step(int number, wire::Mode mode, bool commit_previous = false);

  std::vector<std::uint64_t> first_nodes() const {
    return support::node_ids(3 + 6 * std::uint64_t{number_}, 100 * (number_ + 1));
  }

  std::vector<std::uint64_t> some_nodes();

  // Makes `call` on the session and `expected` on the reference session. Both must end with the same status code, which
  // is returned.
  template <typename Call, typename Expected>
  Code both(const Call& call, const Expected& expected) {
    const Code code = support::code_of([&] { insist(call); });
    EXPECT_EQ(code, support::code_of(expected));
    EXPECT_EQ(session_.node_ids, reference_.node_ids);
    if (code != Code::kOk) ++tally_.refused;
    return code;
  }

  void change_nodes();
  void register_some();
  void retire_some();
  void offer_some();
  void accept_one();

  void mark();
  // Asks for a rollback to one of the last marks. The server refuses if the mark was deleted or contains nodes that
  // another host owns now.
  void go_back();

  void ask_nonsense();

  // Lets the client die after it has sent a request, and resumes the session with a new client. The new client learns
  // whether the request was executed. From then on no packet of the dead client may be executed, and offered nodes must
  // not be lost.
  void die_and_be_succeeded();

  World& world_;
  Tally& tally_;
  Ledger& ledger_;
  unsigned number_;
  std::size_t rows_;
  Strategy strategy_;
  std::shared_ptr<SimulatedConnection> connection_;
  Client client_;
  std::shared_ptr<DirectConnection> reference_connection_;
  Client reference_client_;
  Session session_;
  Session reference_;
  int steps_ = 0;
  struct Mark {
    std::string name;
    std::vector<std::uint64_t> nodes;
    std::size_t offers_before;
  };
  std::vector<Mark> marks_;
};

}  // namespace shearbus::simulation
