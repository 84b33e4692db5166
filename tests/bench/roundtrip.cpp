// shearbus-bench-roundtrip measures the cost of the bus. For each number of nodes it makes two kinds of round trips
// over ipc in turn, and takes the solver's time off both:
//
//   bare     bare ZeroMQ with two frames of the request's sizes one way and two of the reply's sizes back. Each side
//            writes every number that it sends and reads every number that it gets once, and the server computes as
//            long as the solver of the last step of shearbus did.
//   shearbus a step through client and server: codec, checksums, validation. Gather and scatter are part of the
//            solver's time.
//
// Prints medians and their ratio. Run it on an idle machine; only the ratio is comparable between machines.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <string>
#include <thread>
#include <vector>
#include <zmq.hpp>

#include "proto/wire/codec.hpp"
#include "tests/support/running_server.hpp"
#include "tests/support/scenes.hpp"

namespace {

using namespace shearbus;
using Clock = std::chrono::steady_clock;
using Microseconds = std::chrono::duration<double, std::micro>;

constexpr double kDt = 1e-9;
constexpr int kRounds = 400;

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

// A server without shearbus: it answers `rounds` messages with two frames of given sizes.
class BareServer {
 public:
  BareServer(const std::string& endpoint, Sizes reply, int rounds) {
    socket_ = zmq::socket_t(context_, zmq::socket_type::router);
    socket_.bind(endpoint);
    thread_ = std::thread([this, reply, rounds] {
      for (int i = 0; i < rounds; ++i) {
        zmq::message_t peer, header, payload;
        static_cast<void>(socket_.recv(peer));
        static_cast<void>(socket_.recv(header));
        static_cast<void>(socket_.recv(payload));
        const double sum = sum_of(payload);
        const auto until = Clock::now() + std::chrono::nanoseconds(busy_ns_.load());
        while (Clock::now() < until) {
        }
        zmq::message_t answer(reply.payload);
        std::fill_n(answer.data<double>(), reply.payload / sizeof(double), sum);
        socket_.send(peer, zmq::send_flags::sndmore);
        socket_.send(zmq::message_t(reply.header), zmq::send_flags::sndmore);
        socket_.send(answer, zmq::send_flags::none);
      }
    });
  }
  ~BareServer() { thread_.join(); }

  // Time for which the server computes before it answers the next message  [ns].
  void be_busy(std::uint64_t ns) { busy_ns_ = ns; }

 private:
  std::atomic<std::uint64_t> busy_ns_{0};
  zmq::context_t context_;
  zmq::socket_t socket_;
  std::thread thread_;
};

double median(std::vector<double>& values) {
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

void measure(std::size_t nodes) {
  const auto ids = support::node_ids(nodes);
  const auto request = support::step_columns(wire::Strategy::kForceDriven, ids, 0);

  server::ServerOptions options;
  options.threads = 1;
  support::RunningServer server(options);
  Client client = server.client();
  Session session = client.open(support::text_of(support::force_scene(1)), "scene", ids);
  const auto& first = session.advance(request, {.dt_s = kDt});
  // Sizes of the two frames, header and payload. The header of a step has about 120 bytes, that of its reply about 160.
  const Sizes asked = {120, request.bytes().size()};
  const Sizes answered = {160, first.outcome().size() * 2 + first.shear_stress_pa().size() * 5 * sizeof(double)};

  const support::ScratchDirectory scratch;
  BareServer bare_server(scratch.ipc(), answered, kRounds);
  zmq::context_t context;
  zmq::socket_t bare(context, zmq::socket_type::dealer);
  bare.connect(scratch.ipc());

  std::vector<double> bare_us, shearbus_us;
  std::uint64_t busy_ns = 0;
  for (int round = 0; round < kRounds; ++round) {
    const auto started = Clock::now();
    zmq::message_t header(asked.header);
    zmq::message_t payload(request.bytes().data(), request.bytes().size());
    bare.send(header, zmq::send_flags::sndmore);
    bare.send(payload, zmq::send_flags::none);
    static_cast<void>(bare.recv(header));
    static_cast<void>(bare.recv(payload));
    if (std::isnan(sum_of(payload))) std::printf("the request has a NaN\n");  // keeps the sum
    bare_us.push_back(Microseconds(Clock::now() - started).count() - 1e-3 * static_cast<double>(busy_ns));

    const auto asked_at = Clock::now();
    const auto& result = session.advance(request, {.dt_s = kDt});
    const Microseconds whole = Clock::now() - asked_at;
    busy_ns = result.upscale().solver_ns;
    bare_server.be_busy(busy_ns);
    shearbus_us.push_back(whole.count() - 1e-3 * static_cast<double>(busy_ns));
  }
  const double bare_median = median(bare_us);
  const double shearbus_median = median(shearbus_us);
  std::printf("%8zu %12zu %12zu %12.1f %12.1f %8.2f\n", nodes, asked.payload, answered.payload, bare_median,
              shearbus_median, shearbus_median / bare_median);
}

}  // namespace

int main() {
  std::printf("%8s %12s %12s %12s %12s %8s\n", "nodes", "request, B", "reply, B", "bare, us", "shearbus, us", "ratio");
  for (const std::size_t nodes : {100u, 1'000u, 10'000u, 100'000u}) measure(nodes);
  return 0;
}
