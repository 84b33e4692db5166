#include "tests/durability/simulation/world.hpp"

#include <algorithm>

namespace shearbus::simulation {
namespace {

bool is_claim(std::span<const std::span<const std::byte>> frames) {
  wire::Request request;
  wire::decode(frames, request);
  const auto* resume = std::get_if<wire::ResumeSession>(&request.body);
  return resume != nullptr && resume->claim != 0;
}

}  // namespace

World::World(unsigned seed, Tally& tally, std::uint64_t last_epoch, int claims_kill)
    : random(seed),
      durability_(seed % 2 == 0 ? store::Durability::kPower : store::Durability::kProcess),
      tally_(tally),
      epoch_(last_epoch),
      claims_kill_(claims_kill) {
  start();
}

void World::transmit(Packet packet) {
  if (chance(12)) {
    ++tally_.dropped;
    return;
  }
  const auto delay = [&] { return std::chrono::milliseconds(chance(20) ? random() % 2000 : random() % 5); };
  if (chance(12)) {
    ++tally_.repeated;
    network_.emplace(now_ + delay(), packet);
  }
  network_.emplace(now_ + delay(), std::move(packet));
}

std::optional<Packet> World::next(std::uint64_t socket, Clock::time_point until) {
  while (!network_.empty() && network_.begin()->first <= until) {
    now_ = std::max(now_, network_.begin()->first);
    Packet packet = std::move(network_.extract(network_.begin()).mapped());
    if (packet.to_server)
      deliver(packet);
    else if (packet.socket == socket)
      return packet;
  }
  now_ = std::max(now_, until);
  return std::nullopt;
}

void World::start() {
  static constexpr int kFaults[] = {0, 0, EIO, ENOSPC};  // errno of the fault; 0: the machine dies
  if (chance(2)) {
    disk_.plan({.at_call = 1 + random() % 80, .code = kFaults[random() % 4]});
    ++tally_.disk_faults;
  }
  try {
    server_ = std::make_unique<DurableServer>(disk_, durability_, ++epoch_ << 32, 1 + random() % 2,
                                              std::uint64_t{8} << 30, chance(2) ? 1.0 : 0.0);
  } catch (const store::StorageError&) {
    crash();  // the machine may also die while the new server recovers
  }
  if (disk_.dead()) crash();
}

void World::crash() {
  ++tally_.crashes;
  server_.reset();
  held_.clear();
  if (durability_ == store::Durability::kPower)
    disk_.die_of_power(random);
  else
    disk_.die_of_process();
  // The connections to the dead server have ended, so all packets on their way to it are lost.
  std::erase_if(network_, [](const auto& entry) { return entry.second.to_server; });
  if (chance(6)) damage_a_checkpoint();
  back_at_ = now_ + std::chrono::milliseconds(random() % 400);
}

// Flips a bit of the newest checkpoint if the one before it is sound. An older one does not help: it may be a removed file
// that a loss of power has brought back, without the journal behind it.
void World::damage_a_checkpoint() {
  std::vector<std::string> all;
  for (const std::string& name : disk_.names())
    if (name.starts_with("checkpoint-") && name.ends_with(".h5")) all.push_back(name);
  if (all.size() < 2 || damaged_.contains(all.back()) || damaged_.contains(all[all.size() - 2])) return;
  auto& bytes = disk_.bytes(all.back());
  bytes[random() % bytes.size()] ^= static_cast<std::byte>(1U << random() % 8);
  damaged_.insert(all.back());
  ++tally_.damaged;
}

void World::deliver(Packet packet) {
  if (!server_ && now_ >= back_at_) start();
  if (!server_) return;
  held_.push_back(std::move(packet));
  if (ask(held_.back()))
    ++tally_.held;
  else if (server_)
    held_.pop_back();
  if (server_) compute();
  if (server_ && chance(12) && server_->service.checkpoint()) ++tally_.checkpoints;
  if (server_ && chance(12)) {
    server_->clock += 2'000'000'000;
    server_->service.prove_last_replies();
  }
  if (disk_.dead() || (server_ && server_->service.failed())) crash();
}

// Asks the server once. Returns whether the request waits. The server may die of it.
bool World::ask(const Packet& packet) {
  const std::span<const std::byte> both[2] = {std::as_bytes(std::span(packet.header)), packet.payload};
  const std::span frames(both, wire::declares_payload(both[0]) ? 2 : 1);
  service::Turn turn{};
  auto answer = server_->try_ask(frames, {}, &turn);
  // A server that dies after it has run a request never sends its answer.
  if (disk_.dead() || server_->service.failed() || chance(is_claim(frames) ? claims_kill_ : kRequestsKill)) {
    crash();
    return false;
  }
  if (answer)
    transmit(
        {.to_server = false, .socket = packet.socket, .header = answer->frames.header, .payload = answer->payload()});
  return turn != service::Turn::kAnswered;
}

// Lets the server compute a few slices of the steps that wait, and asks again where a step is complete.
void World::compute() {
  for (std::uint32_t slices = random() % 8; slices > 0 && server_->service.computing(); --slices) {
    if (!server_->service.work()) continue;
    for (auto packet = held_.begin(); packet != held_.end();) {
      const bool waits = ask(*packet);
      if (!server_) return;
      packet = waits ? std::next(packet) : held_.erase(packet);
    }
  }
}

}  // namespace shearbus::simulation
