// Writes the initial inputs of the fuzz targets, into one directory for each target. The committed corpus was grown
// from these inputs. Usage:
//   shearbus-fuzz-seeds DIRECTORY
#include <filesystem>
#include <fstream>
#include <iostream>
#include <string>

#include "proto/scene/scene.hpp"
#include "shearbus/v1/envelope.pb.h"
#include "shearbus_places.hpp"
#include "tests/fuzz/checkpoint_sample.hpp"
#include "tests/fuzz/mutate.hpp"
#include "tests/fuzz/pairs_sample.hpp"
#include "tests/fuzz/script.hpp"
#include "tests/fuzz/target.hpp"
#include "tests/support/wire_samples.hpp"

// The linker needs this function, because the mutators of the fuzz targets, which are linked to this program, refer to
// it. The program calls no mutator, so the function does nothing.
extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t*, std::size_t size, std::size_t) {
  return size;
}

namespace shearbus::fuzz {
namespace {

using support::ServiceHarness;
using wire::Strategy;

class Corpus {
 public:
  explicit Corpus(std::filesystem::path directory) : directory_(std::move(directory)) {}
  void add(const std::string& target, const std::string& name, const std::string& input) const {
    std::filesystem::create_directories(directory_ / target);
    std::ofstream(directory_ / target / name, std::ios::binary) << input;
  }

 private:
  std::filesystem::path directory_;
};

std::string text(std::span<const std::byte> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

template <typename Message>
Parts parts_of(const Message& message) {
  Parts parts = {wire::encode_header(message)};
  if (!message.batch.columns().empty()) parts.push_back(text(message.batch.bytes()));
  return parts;
}

// Builds a sequence of requests for the fuzz target `service`. The requests lack the fields that the target fills in
// itself (magic, version, session, sequence, checksum), so that they remain valid if a mutation reorders them.
class Script {
 public:
  void ask(const wire::Request& request) {
    Parts parts = parts_of(request);
    parts.resize(2);
    v1::RequestHeader header;
    header.ParseFromString(parts[0]);
    header.set_request_id(request.session_id == ServiceHarness::id(2) ? 2 : 1);
    header.clear_session_id();
    header.clear_sequence();
    header.clear_magic();
    header.clear_protocol_major();
    if (header.has_payload()) header.mutable_payload()->clear_xxh3();
    parts_.push_back(header.SerializeAsString());
    parts_.push_back(parts[1]);
  }
  template <typename Body>
  void tell(Body body, std::uint8_t session = 1) {
    ask(ServiceHarness::in_session(std::move(body), 1, session));
  }
  void step(Strategy strategy, wire::Mode mode = wire::Mode::kAdvance, std::uint8_t session = 1,
            bool with_ids = false) {
    ask(ServiceHarness::step(1, support::step_columns(strategy, nodes, ++steps_, with_ids), mode, session));
  }
  void event(const std::string& event) { parts_.insert(parts_.end(), {event, ""}); }
  std::string input() const { return pack(parts_); }

  std::vector<std::uint64_t> nodes = support::node_ids(3);

 private:
  Parts parts_;
  int steps_ = 0;
};

v1::Scene with_options(Strategy strategy) {
  v1::Scene scene = strategy == Strategy::kVelocityDriven ? support::velocity_scene(6) : support::force_scene(6);
  scene.mutable_hard_layer();
  if (strategy == Strategy::kVelocityDriven) scene.mutable_velocity_driven()->set_taylor_quinney_factor(0.9);
  return scene;
}

void service_seeds(const Corpus& corpus) {
  for (const Strategy strategy : {Strategy::kVelocityDriven, Strategy::kForceDriven}) {
    const std::string suffix = strategy == Strategy::kVelocityDriven ? "_velocity" : "_force";
    Script steps;
    steps.tell(wire::Hello{.client_name = "seed"});
    steps.ask(ServiceHarness::opening(
        strategy == Strategy::kVelocityDriven ? support::velocity_scene(6) : support::force_scene(6), steps.nodes));
    for (int i = 0; i < 3; ++i) steps.step(strategy, wire::Mode::kAdvance, 1, i == 1);
    steps.tell(wire::ServerStatusQuery{});
    steps.tell(wire::CloseSession{.reason = "done"});
    corpus.add("service", "steps" + suffix, steps.input());

    Script trials;
    trials.ask(ServiceHarness::opening(with_options(strategy), trials.nodes));
    trials.step(strategy, wire::Mode::kTrial);
    trials.tell(wire::Commit{});
    trials.tell(wire::Mark{.name = "a"});
    trials.step(strategy, wire::Mode::kTrial);
    trials.event(kCheckpointEvent);
    trials.step(strategy, wire::Mode::kTrial);
    trials.event(kRestartEvent);
    trials.tell(wire::Rollback{});
    trials.step(strategy);
    trials.tell(wire::Mark{.name = "b"});
    trials.tell(wire::Mark{.name = "c"});
    trials.tell(wire::Rollback{.to_mark = "b"});
    trials.event(kRestartEvent);
    trials.step(strategy);
    corpus.add("service", "trials" + suffix, trials.input());
  }
  Script two;
  wire::ResumeToken token{};
  token.fill(9);
  wire::Request opening = ServiceHarness::opening(support::force_scene(6), two.nodes, 1);
  std::get<wire::OpenSession>(opening.body).resume_token = token;
  two.ask(opening);
  two.ask(ServiceHarness::opening(support::velocity_scene(6), two.nodes, 2));
  two.step(Strategy::kForceDriven, wire::Mode::kAdvance, 1);
  two.step(Strategy::kVelocityDriven, wire::Mode::kAdvance, 2);
  two.tell(wire::ResumeSession{.resume_token = token, .claim = 0, .claimant = 0});
  two.step(Strategy::kForceDriven, wire::Mode::kTrial, 1);
  two.tell(wire::CloseSession{}, 2);
  two.event(kCheckpointEvent);
  two.event(kRestartEvent);
  two.tell(wire::Commit{}, 1);
  corpus.add("service", "two_sessions", two.input());
}

// Sessions of several pairs and of nodes with parameters: registered, moved, retired, marked, restored and resumed.
void pair_seeds(const Corpus& corpus) {
  for (const Strategy strategy : {Strategy::kVelocityDriven, Strategy::kForceDriven}) {
    const std::string suffix = strategy == Strategy::kVelocityDriven ? "_velocity" : "_force";
    const v1::Scene scene =
        strategy == Strategy::kVelocityDriven ? support::velocity_scene(6) : support::force_scene(6);
    const auto late = support::node_ids(2, 900);
    Script pairs;
    wire::ResumeToken token{};
    token.fill(9);
    wire::Request opening = opening_of_pairs(scene, pairs.nodes);
    std::get<wire::OpenSession>(opening.body).resume_token = token;
    pairs.ask(opening);
    pairs.step(strategy);
    pairs.tell(wire::Mark{.name = "a"});
    pairs.ask(registration_of_pairs(1, late));
    const auto first = pairs.nodes;
    pairs.nodes.insert(pairs.nodes.end(), late.begin(), late.end());
    pairs.step(strategy, wire::Mode::kTrial);
    pairs.event(kCheckpointEvent);
    pairs.event(kRestartEvent);
    pairs.tell(wire::ResumeSession{.resume_token = token, .claim = 0, .claimant = 0});
    pairs.tell(wire::Commit{});
    pairs.ask(ServiceHarness::of_nodes(wire::RetireNodes{}, std::vector{pairs.nodes[1]}, 1));
    pairs.tell(wire::Rollback{.to_mark = "a"});
    pairs.nodes = first;
    pairs.step(strategy);
    pairs.event(kRestartEvent);
    pairs.step(strategy);
    corpus.add("service", "pairs" + suffix, pairs.input());

    Script moved;
    moved.ask(opening_of_pairs(scene, moved.nodes, 1, "d"));
    moved.ask(opening_of_pairs(scene, late, 2, "d"));
    wire::TransferId transfer{};
    transfer.fill(5);
    moved.ask(ServiceHarness::of_nodes(wire::OfferNodes{.transfer_id = transfer}, std::vector{moved.nodes[2]}, 1));
    moved.event(kCheckpointEvent);
    moved.tell(wire::AcceptNodes{.transfer_id = transfer}, 2);
    moved.nodes.pop_back();
    moved.step(strategy);
    moved.tell(wire::CloseSession{}, 2);
    corpus.add("service", "pairs_moved" + suffix, moved.input());
  }
}

void journal_seeds(const Corpus& corpus) {
  for (const Strategy strategy : {Strategy::kVelocityDriven, Strategy::kForceDriven}) {
    support::MemoryStorage disk;
    support::DurableServer server(disk);
    const auto nodes = support::node_ids(3);
    std::uint64_t sequence = 0;
    const auto tell = [&](auto body) { server.ask(ServiceHarness::in_session(std::move(body), ++sequence)); };
    server.ask(ServiceHarness::opening(with_options(strategy), nodes));
    server.ask(ServiceHarness::step(++sequence, support::step_columns(strategy, nodes, 1), wire::Mode::kTrial));
    tell(wire::Commit{});
    tell(wire::Mark{.name = "a"});
    server.ask(ServiceHarness::step(++sequence, support::step_columns(strategy, nodes, 2)));
    tell(wire::Rollback{.to_mark = "a"});
    tell(wire::CloseSession{});
    const std::string bytes = text(disk.bytes(store::segment_name(1)));
    const std::string suffix = strategy == Strategy::kVelocityDriven ? "_velocity" : "_force";
    corpus.add("journal", "whole" + suffix, bytes);
    corpus.add("journal", "torn" + suffix, bytes.substr(0, bytes.size() - 20));
    corpus.add("journal", "zeros" + suffix, bytes + std::string(100, '\0'));

    support::MemoryStorage disk_of_pairs;
    support::DurableServer several(disk_of_pairs);
    several.ask(opening_of_pairs(with_options(strategy), nodes));
    several.ask(ServiceHarness::step(1, support::step_columns(strategy, nodes, 1)));
    several.ask(registration_of_pairs(2, support::node_ids(2, 900)));
    several.ask(ServiceHarness::in_session(wire::Mark{.name = "a"}, 3));
    several.ask(ServiceHarness::in_session(wire::Rollback{.to_mark = "a"}, 4));
    corpus.add("journal", "pairs" + suffix, text(disk_of_pairs.bytes(store::segment_name(1))));
  }
  corpus.add("journal", "empty", std::string(sizeof(store::SegmentHeader), '\0'));
}

void scene_seeds(const Corpus& corpus) {
  const std::filesystem::path source = SHEARBUS_SOURCE_DIR;
  for (const char* directory : {"client/examples", "hydro_stub/problems"})
    for (const auto& entry : std::filesystem::directory_iterator(source / directory))
      if (entry.path().extension() == ".toml")
        corpus.add("scene", entry.path().stem().string(), scene::load_text(entry.path()));
  corpus.add("scene", "velocity", scene::to_toml(with_options(Strategy::kVelocityDriven)));
  corpus.add("scene", "force", scene::to_toml(with_options(Strategy::kForceDriven)));
  corpus.add("scene", "pairs_velocity", scene_of_pairs(with_options(Strategy::kVelocityDriven)));
  corpus.add("scene", "pairs_force", scene_of_pairs(support::force_scene(6)));
  corpus.add("scene", "sample", wire::samples::kScene);
}

void write(const Corpus& corpus) {
  for (const auto& [name, request] : wire::samples::requests()) corpus.add("frames", name, pack(parts_of(request)));
  for (const auto& [name, reply] : wire::samples::replies())
    corpus.add("frames", "reply_" + name, pack(parts_of(reply)));
  service_seeds(corpus);
  pair_seeds(corpus);
  journal_seeds(corpus);
  scene_seeds(corpus);
  corpus.add("checkpoint", "sample", text(sample_checkpoint()));
  for (char kind = 0; kind < 6; ++kind)
    for (char at = 0; at < 64; at = static_cast<char>(at + 7))
      corpus.add("checkpoint_content", std::to_string(kind) + "_" + std::to_string(at),
                 std::string{kind, at, 0, at, static_cast<char>(at / 3), at, at, at});
}

}  // namespace
}  // namespace shearbus::fuzz

int main(int argc, char** argv) {
  if (argc != 2) {
    std::cerr << "usage: " << argv[0] << " DIRECTORY\n";
    return 2;
  }
  shearbus::fuzz::write(shearbus::fuzz::Corpus(argv[1]));
  return 0;
}
