#include "client/replay/log.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <variant>

#include "proto/wire/codec.hpp"

namespace shearbus::replay {
namespace {

// Whether a request is refused with this code again when it is repeated in the same states.
bool is_of_states_or_content(Code code) {
  constexpr std::array kCodes = {Code::kShape,       Code::kUnsupported,   Code::kNothingToCommit,
                                 Code::kUnknownMark, Code::kTrialStands,   Code::kInvalidValue,
                                 Code::kUnknownNode, Code::kDuplicateNode, Code::kUnknownTransfer,
                                 Code::kOtherScene,  Code::kStepFailed};
  return std::ranges::find(kCodes, code) != kCodes.end();
}

template <typename Message>
void decode(std::span<const std::byte> header, std::span<const std::byte> payload, Message& message) {
  const std::array frames = {header, payload};
  wire::decode(std::span(frames).first(wire::declares_payload(header) ? 2 : 1), message);
}

}  // namespace

Log::Log(const std::filesystem::path& file) : name_(file.string()), reader_(file) {}

bool Log::next() {
  while (reader_.next()) {
    const files::ExchangeFrames& frames = reader_.frames();
    if (frames.reply_header.empty()) continue;
    bool asked = false;  // true once the reply is decoded: a fault after that is of the request
    try {
      decode(frames.reply_header, frames.reply_payload, reply_);
      asked = true;
      decode(frames.request_header, frames.request_payload, request_);
    } catch (const Error& fault) {
      if (!asked || reply_.status.ok())
        throw Error({.code = Code::kInvalidValue,
                     .text = fmt::format("{}, record {}: {}", name_, reader_.index(), fault.status().text)});
      ++left_out_;
      continue;
    }
    if (std::holds_alternative<wire::ResumeSession>(request_.body) ||
        std::holds_alternative<wire::ReadProfiles>(request_.body))
      continue;
    if (!reply_.status.ok()) {
      if (expected_ > 0 && request_.sequence == expected_ && is_of_states_or_content(reply_.status.code)) return true;
      ++left_out_;
      continue;
    }
    if (request_.sequence < expected_) continue;
    if (request_.sequence > expected_)
      throw Error({.code = Code::kInvalidValue,
                   .text = fmt::format("{}: request {} is missing before request {} in record {}", name_, expected_,
                                       request_.sequence, reader_.index()),
                   .remedy = "The recorder ended between answering it and recording it, and nobody asked again."});
    ++expected_;
    return true;
  }
  return false;
}

void NodeOrder::follow(const wire::Request& request, const wire::Reply& reply) {
  if (!reply.status.ok()) return;
  const auto asked = request.batch.u64(Field::kNodeId);
  const auto answered = reply.batch.u64(Field::kNodeId);
  if (std::holds_alternative<wire::OpenSession>(request.body)) {
    ids_.assign(asked.begin(), asked.end());
  } else if (std::holds_alternative<wire::RegisterNodes>(request.body)) {
    ids_.insert(ids_.end(), asked.begin(), asked.end());
  } else if (std::holds_alternative<wire::AcceptNodes>(request.body)) {
    ids_.insert(ids_.end(), answered.begin(), answered.end());
  } else if (std::holds_alternative<wire::RetireNodes>(request.body) ||
             std::holds_alternative<wire::OfferNodes>(request.body)) {
    std::vector<std::uint64_t> gone(asked.begin(), asked.end());
    std::ranges::sort(gone);
    std::erase_if(ids_, [&](std::uint64_t id) { return std::ranges::binary_search(gone, id); });
  } else if (const auto* back = std::get_if<wire::Rollback>(&request.body); back != nullptr && !back->to_mark.empty()) {
    ids_.assign(answered.begin(), answered.end());
  }
}

std::span<const std::uint64_t> NodeOrder::rows_of(const wire::Request& step) const {
  return step.batch.has(Field::kNodeId) ? step.batch.u64(Field::kNodeId) : std::span<const std::uint64_t>(ids_);
}

}  // namespace shearbus::replay
