// shearbus-bench-roundtrip measures the cost of the bus. For each transport and number of nodes it makes two kinds of
// round trips in turn, and takes the solver's time off both:
//
//   bare     bare ZeroMQ with two frames of the request's sizes one way and two of the reply's sizes back. Each side
//            writes every number that it sends and reads every number that it gets once, and the server computes as
//            long as the solver of the last step of shearbus did, so that the client sleeps as long, too.
//   shearbus a step through client and server: codec, checksums, validation. Gather and scatter are part of the
//            solver's time.
//
// Prints the medians, their ratio, that of the lowest tenths, and the allocations of a round trip on both sides
// together, libzmq's included; with an argument it also writes them to this file as JSON. A second argument divides the
// number of rounds. Run it on an idle machine; only the ratio is comparable between machines.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>
#include <zmq.hpp>

#include "proto/wire/codec.hpp"
#include "server/version.hpp"
#include "tests/support/counted_malloc.hpp"
#include "tests/support/running_server.hpp"
#include "tests/support/scenes.hpp"

namespace {

using namespace shearbus;
using Clock = std::chrono::steady_clock;
using Microseconds = std::chrono::duration<double, std::micro>;

constexpr double kDt = 1e-9;

struct Case {
  std::size_t nodes;
  int rounds;
};
constexpr Case kCases[] = {{100, 1'000}, {1'000, 600}, {10'000, 300}, {100'000, 100}};

struct Sizes {
  std::size_t header;
  std::size_t payload;
};

// Returns the sum of the numbers in a frame.
double sum_of(const zmq::message_t& frame) {
  const auto* numbers = frame.data<double>();
  double sum = 0.0;
  for (std::size_t i = 0; i < frame.size() / sizeof(double); ++i) sum += numbers[i];
  return sum;
}

// A server without shearbus: it answers messages with two frames of given sizes until it gets an empty header.
class BareServer {
 public:
  BareServer(zmq::context_t& context, const std::string& endpoint, Sizes reply)
      : socket_(context, zmq::socket_type::router) {
    socket_.bind(endpoint);
    endpoint_ = socket_.get(zmq::sockopt::last_endpoint);
    thread_ = std::thread([this, reply] {
      for (;;) {
        zmq::message_t peer, header, payload;
        static_cast<void>(socket_.recv(peer));
        static_cast<void>(socket_.recv(header));
        if (!header.more()) return;
        static_cast<void>(socket_.recv(payload));
        const double sum = sum_of(payload);
        const auto begun = Clock::now();
        const auto until = begun + std::chrono::nanoseconds(busy_ns_.load());
        auto now = begun;
        while (now < until) now = Clock::now();
        computed_ns_ = static_cast<std::uint64_t>(std::chrono::nanoseconds(now - begun).count());
        zmq::message_t answer(reply.payload);
        std::fill_n(answer.data<double>(), reply.payload / sizeof(double), sum);
        socket_.send(peer, zmq::send_flags::sndmore);
        socket_.send(zmq::message_t(reply.header), zmq::send_flags::sndmore);
        socket_.send(answer, zmq::send_flags::none);
      }
    });
  }
  ~BareServer() { thread_.join(); }

  const std::string& endpoint() const { return endpoint_; }
  // Time for which the server computes before it answers the next message  [ns].
  void be_busy(std::uint64_t ns) { busy_ns_ = ns; }
  // Time for which it did: longer where another program had the processor meanwhile, as the solver's time is  [ns].
  std::uint64_t computed_ns() const { return computed_ns_; }

 private:
  std::atomic<std::uint64_t> busy_ns_{0};
  std::atomic<std::uint64_t> computed_ns_{0};
  zmq::socket_t socket_;
  std::string endpoint_;
  std::thread thread_;
};

// Returns the value below which this share of the values lies.
double quantile(std::vector<double>& values, double share) {
  const auto place = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size()));
  std::nth_element(values.begin(), place, values.end());
  return *place;
}
double median(std::vector<double>& values) {
  return quantile(values, 0.5);
}
// What other programs of the machine disturb least.
double lowest_tenth(std::vector<double>& values) {
  return quantile(values, 0.1);
}

// Times and allocations of the round trips of one kind.
struct Trips {
  std::vector<double> us;
  std::vector<double> allocations;

  template <typename Trip>
  void make(const Trip& trip) {  // trip() returns the solver's time  [ns]
    const long before = support::allocations_of_program;
    const auto started = Clock::now();
    const std::uint64_t solver_ns = trip();
    const Microseconds whole = Clock::now() - started;
    us.push_back(whole.count() - 1e-3 * static_cast<double>(solver_ns));
    allocations.push_back(static_cast<double>(support::allocations_of_program - before));
  }
};

nlohmann::json measure(const std::string& transport, const Case& of, int rounds) {
  const auto ids = support::node_ids(of.nodes);
  const auto request = support::step_columns(wire::Strategy::kForceDriven, ids, 0);

  server::ServerOptions options;
  options.threads = 1;
  support::RunningServer server(options);
  Client client = server.client(transport);
  Session session = client.open(support::text_of(support::force_scene(1)), "scene", ids);
  const auto& first = session.advance(request, {.dt_s = kDt});
  // Sizes of the two frames, header and payload. The header of a step has about 170 bytes, that of its reply about 180.
  const Sizes asked = {170, request.bytes().size()};
  const Sizes answered = {180, first.batch().bytes().size()};

  const support::ScratchDirectory scratch;
  zmq::context_t context;
  zmq::context_t server_context;
  const bool inside = transport == "inproc";
  BareServer bare_server(inside ? context : server_context,
                         inside               ? "inproc://bare"
                         : transport == "tcp" ? "tcp://127.0.0.1:*"
                                              : scratch.ipc(),
                         answered);
  zmq::socket_t bare(context, zmq::socket_type::dealer);
  bare.connect(bare_server.endpoint());

  Trips bare_trips, trips;
  std::uint64_t busy_ns = first.upscale().solver_ns;
  for (int round = 0; round < rounds; ++round) {
    bare_server.be_busy(busy_ns);
    bare_trips.make([&] {
      zmq::message_t header(asked.header);
      zmq::message_t payload(request.bytes().data(), request.bytes().size());
      bare.send(header, zmq::send_flags::sndmore);
      bare.send(payload, zmq::send_flags::none);
      static_cast<void>(bare.recv(header));
      static_cast<void>(bare.recv(payload));
      if (std::isnan(sum_of(payload))) std::printf("the request has a NaN\n");  // keeps the sum
      return bare_server.computed_ns();
    });
    trips.make([&] { return busy_ns = session.advance(request, {.dt_s = kDt}).upscale().solver_ns; });
  }
  bare.send(zmq::message_t(), zmq::send_flags::none);

  const double bare_us = median(bare_trips.us);
  const double shearbus_us = median(trips.us);
  const double low = lowest_tenth(trips.us) / lowest_tenth(bare_trips.us);
  const double bare_allocations = median(bare_trips.allocations);
  const double shearbus_allocations = median(trips.allocations);
  std::printf("%-6s %8zu %10zu %10zu %10.1f %10.1f %8.2f %8.2f %8.0f %8.0f\n", transport.c_str(), of.nodes,
              asked.payload, answered.payload, bare_us, shearbus_us, shearbus_us / bare_us, low, bare_allocations,
              shearbus_allocations);
  std::fflush(stdout);
  return {{"transport", transport},
          {"nodes", of.nodes},
          {"rounds", rounds},
          {"request_bytes", asked.payload},
          {"reply_bytes", answered.payload},
          {"bare_us", bare_us},
          {"bare_lowest_us", lowest_tenth(bare_trips.us)},
          {"shearbus_us", shearbus_us},
          {"shearbus_lowest_us", lowest_tenth(trips.us)},
          {"ratio", shearbus_us / bare_us},
          {"ratio_of_lowest_tenths", low},
          {"bare_allocations", bare_allocations},
          {"shearbus_allocations", shearbus_allocations}};
}

}  // namespace

int main(int argc, char** argv) {
  nlohmann::json result;
  for (const auto& [key, value] :
       server::provenance("shearbus-bench-roundtrip", "force_scene of tests/support/scenes.hpp",
                          std::span<const char* const>(argv, static_cast<std::size_t>(argc))))
    result[key] = value;
  const int divisor = argc > 2 ? std::max(1, std::atoi(argv[2])) : 1;
  std::printf("%-6s %8s %10s %10s %10s %10s %8s %8s %8s %8s\n", "", "nodes", "request, B", "reply, B", "bare, us",
              "whole, us", "ratio", "lowest", "bare", "allocs");
  for (const char* transport : {"ipc", "tcp", "inproc"})
    for (const Case& of : kCases) result["round_trips"].push_back(measure(transport, of, of.rounds / divisor));
  if (argc > 1) std::ofstream(argv[1]) << result.dump(2) << "\n";
  return 0;
}
