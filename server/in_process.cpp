#include "server/in_process.hpp"

#include <array>
#include <cstdint>
#include <limits>
#include <stdexcept>

#include "server/host.hpp"
#include "server/service/service.hpp"
#include "server/shard/task_pool.hpp"

namespace shearbus::server {

struct InProcess::Impl {
  explicit Impl(unsigned threads)
      : pool(threads),
        service({.server_version = SHEARBUS_RELEASE,
                 .max_state_bytes = std::numeric_limits<std::uint64_t>::max() / 2,
                 .now_ns = monotonic_ns},
                pool) {}
  shard::TaskPool pool;
  service::Service service;
};

InProcess::InProcess(unsigned threads) : impl_(std::make_unique<Impl>(threads)) {}
InProcess::~InProcess() = default;

InProcess::Answer InProcess::answer(std::span<const std::byte> header,
                                    std::optional<std::span<const std::byte>> payload) {
  const std::array frames = {header, payload.value_or(std::span<const std::byte>())};
  auto sent = impl_->service.handle(service::Frames(frames).first(payload ? 2 : 1),
                                    {.identity = "process", .in_process = true});
  if (!sent) throw std::runtime_error("there is no memory for the answer of the service");
  return {std::move(sent->header), sent->payload, std::move(sent->owner)};
}

void InProcess::change_scene(const wire::SessionId& session, const std::string& scene, const std::string& scene_file) {
  impl_->service.change_scene(session, scene, scene_file);
}

}  // namespace shearbus::server
