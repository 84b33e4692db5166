// What the calls of the C++ client take and return (client.hpp, session.hpp).
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "proto/wire/batch.hpp"
#include "proto/wire/messages.hpp"
#include "proto/wire/status.hpp"

namespace shearbus {

using wire::AbsentNodes;
using wire::Batch;
using wire::Code;
using wire::Error;
using wire::Field;
using wire::Form;
using wire::Policy;
using wire::Status;
using wire::TransferId;

// Whether the jumps of a force-driven host are compared with those that were answered, as SHEARBUS_CHECK_... of shearbus.h
// says, with its numbers. Unless it is off, sessions of both strategies also warn of doubtful times and inputs
// (input_check.hpp). kError throws kNotClosed in place of a step that differs.
enum class CheckClosure { kWarn, kOff, kError };

struct ClientOptions {
  // tcp://host:port, ipc://path, inproc://name, or file://path of a server's endpoint file. Several endpoints with a
  // comma between them, or file://path of a directory of endpoint files: the nodes are divided over these servers
  // (proto/WIRE.md, "Several servers").
  std::string endpoint;
  void* context = nullptr;  // libzmq context to use; required for inproc; null: a context of its own
  std::string server_key;   // tcp: the server's public CURVE key; empty: that of the endpoint file, or no encryption
  std::string secret_key;   // this client's secret key, required with server_key
  std::string name = "shearbus-client";               // name of this client in the server's log
  std::chrono::milliseconds connect_deadline{5'000};  // deadline of connecting and the first exchange
  std::chrono::milliseconds reply_deadline{60'000};   // deadline of any other call, retries included
  std::chrono::milliseconds retry_after{5'000};       // time after which the request is repeated on a fresh socket
  bool wait_for_recovery = true;  // a call to a server that recovers its sessions waits as long as that takes
  CheckClosure check_closure = CheckClosure::kWarn;
  // Called from inside a call that has waited for 2 s, then after 4, 8, ... s, with what the call waits for; and with
  // "warning: " followed by a warning about a step. Without a log function warnings go to standard error, and from 10 s
  // on so does what a call waits for.
  std::function<void(const std::string& line)> log;
  // Called from inside a call that waits, every 0.1 s and after each signal. True: the call ends as if its deadline had
  // passed.
  std::function<bool()> interrupted;
  // A directory or a new file that gets event logs of this client's sessions (proto/files/event_log.md); empty: none.
  std::string record;
};

// Gives a line to a log, or without one to standard error.
void write_line(const std::function<void(const std::string& line)>& log, const std::string& line);

// A new pair of CURVE keys, each of 40 characters.
struct KeyPair {
  std::string public_key;
  std::string secret_key;
};
KeyPair make_key_pair();

// Properties of new nodes by which they differ from the scene. All lists have one value per node or are empty.
struct NodeOptions {
  std::span<const double> initial_temperature_k;  // empty: the value of the scene
  // The material pair of each node: `pair` holds places in `pairs`, names of tables [pair.NAME] of the scene; the name ""
  // stands for the tables outside of them. Empty: all nodes have the constants of these.
  std::vector<std::string> pairs;
  std::span<const std::uint64_t> pair;
  // Numbers of the scene that have another value for each node, by their keys, as "interface.friction_coefficient". The
  // opening of a session chooses the keys; later nodes give values for all of them, or for none: then they have those of
  // their pairs.
  struct Parameter {
    std::string key;
    std::span<const double> values;  // in the key's unit
  };
  std::vector<Parameter> parameters;
};

// What the host of a resumed session takes its nodes for. Nodes, pairs and parameters that are given must be those of the
// session; empty lists, and the initial temperatures, are not compared.
struct ExpectedNodes {
  std::span<const std::uint64_t> node_ids;
  NodeOptions options;
};

// The nodes of a resumed session as the server told them, in the order that they had then. Without pairs and parameters in
// the scene, and if the server did not tell, the lists of these are empty.
struct ResumedNodes {
  std::vector<std::uint64_t> node_ids;
  std::vector<std::uint64_t> pair;              // 0: the tables outside of the pairs; i: the i-th pair of the scene
  std::vector<std::vector<double>> parameters;  // values of each key of the session
};

struct OpenOptions {
  NodeOptions nodes = {};
  // Node ids are unique among the sessions of a domain, such as the ranks of one run, and nodes can move between these
  // sessions. Empty: the session is in no domain, and must be opened with at least one node.
  std::string domain;
  std::uint64_t idle_limit_s = 0;  // the server closes the session after this time without a request; 0: never
};

// What proto/shearbus/v1/downscale.proto says of a step. A session sets its parts.
using StepOptions = wire::Downscale;

struct Received {
  std::shared_ptr<void> payload_frame;  // the frame that the batch of `reply` points into
  wire::Reply reply;
  std::chrono::nanoseconds round_trip{0};
};

// The reply to a step. A column has one value per row of the request, in the order of the request, and is valid until
// the session's next call. Tangential columns have a second component, with index 1, if the scene has
// tangential_components = 2.
struct StepResult : Received {
  std::span<const double> shear_stress_pa(std::uint32_t component = 0) const {
    return reply.batch.f64(Field::kShearStress, component);
  }
  std::span<const double> interface_temperature_k() const { return reply.batch.f64(Field::kInterfaceTemperature); }
  const Batch& batch() const { return reply.batch; }  // all columns of the reply
  const wire::Upscale& upscale() const { return std::get<wire::Upscale>(reply.body); }
};

}  // namespace shearbus
