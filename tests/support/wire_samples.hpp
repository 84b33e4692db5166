// At least one sample message of every kind of request and reply, and the frames of a message as a socket delivers
// them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "proto/wire/codec.hpp"

namespace shearbus::wire::samples {

using Bytes = std::vector<std::byte>;

inline Bytes to_bytes(std::string_view text) {
  const auto bytes = std::as_bytes(std::span(text));
  return {bytes.begin(), bytes.end()};
}

// Owns the frames of one message.
struct Frames {
  std::vector<Bytes> frames;

  std::vector<std::span<const std::byte>> views() const { return {frames.begin(), frames.end()}; }
};

template <typename Message>
Frames frames_of(const Message& message) {
  Frames result{{to_bytes(encode_header(message))}};
  if (!message.batch.columns().empty()) {
    const auto bytes = message.batch.bytes();
    result.frames.emplace_back(bytes.begin(), bytes.end());
  }
  return result;
}

inline SessionId session_id() {
  return {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 255};
}

inline const std::string kScene =
    "name = \"sample\"\nsource = \"made up \xC3\xA9\"\nstrategy = \"force_driven\"\n[soft]\nmaterial = "
    "\"aluminium_dlp\"\n"
    "yield_strength_pa = 210e6\nhardening_exponent = 0.1\n[hard]\nmaterial = \"steel_dlp\"\n[layer]\nthickness_m = "
    "200e-6\n"
    "cells = 60\ngrading = 1.08\nfar_boundary = \"half_space\"\ninitial_temperature_k = 310\n[velocity_driven]\n"
    "drive = \"interface_slip\"\nfriction_coefficient = 0.2\n[interface]\nfriction_coefficient = 0.3\n"
    "yield_strength_pa = 200e6\n";

template <typename Message, typename Body>
Message enveloped(Body body) {
  Message message;
  message.request_id = 0x0123456789abcdef;
  message.session_id = session_id();
  message.sequence = 42;
  message.epoch = 7;
  message.body = std::move(body);
  return message;
}

inline Batch step_columns(std::size_t nodes) {
  const Field fields[] = {Field::kNodeId, Field::kVelocityJump, Field::kPressure};
  Batch batch = Batch::of(fields, nodes);
  for (std::size_t i = 0; i < nodes; ++i) {
    batch.u64(Field::kNodeId)[i] = 4711 + i;
    batch.f64(Field::kVelocityJump)[i] = 100.0 - 0.1 * static_cast<double>(i);
    batch.f64(Field::kPressure)[i] = 11.2e9 + static_cast<double>(i);
  }
  return batch;
}

inline Batch answer_columns(std::size_t nodes) {
  const Field fields[] = {Field::kShearStress, Field::kRegime, Field::kInterfaceTemperature, Field::kOutcome};
  Batch batch = Batch::of(fields, nodes);
  for (std::size_t i = 0; i < nodes; ++i) {
    batch.f64(Field::kShearStress)[i] = -1.5e8 - static_cast<double>(i);
    batch.u8(Field::kRegime)[i] = static_cast<std::uint8_t>(i % 5);
    batch.f64(Field::kInterfaceTemperature)[i] = 300.0 + 0.3 * static_cast<double>(i);
    batch.u8(Field::kOutcome)[i] = i % 3 == 0 ? kSubstepped : kOutcomeOk;
  }
  return batch;
}

inline std::vector<std::pair<std::string, Request>> requests() {
  std::vector<std::pair<std::string, Request>> all;
  const auto add = [&](const char* name, auto body, Batch batch = {}) {
    all.emplace_back(name, enveloped<Request>(std::move(body)));
    all.back().second.batch = std::move(batch);
  };
  add("hello", Hello{.oldest_major = 1, .newest_major = 3, .client_name = "sample client"});
  const Field opening[] = {Field::kNodeId, Field::kInitialTemperature};
  Batch nodes = Batch::of(opening, 3);
  for (std::size_t i = 0; i < 3; ++i) {
    nodes.u64(Field::kNodeId)[i] = 1ULL << (20 * i);
    nodes.f64(Field::kInitialTemperature)[i] = 300.0 + static_cast<double>(i);
  }
  Batch more_nodes = Batch::of(std::span(opening, 1), 2);
  add("open_session", OpenSession{.scene = kScene, .scene_file = "sample.toml", .session_id = session_id()},
      std::move(nodes));
  add("downscale",
      Downscale{.dt_s = 1e-9,
                .time_s = 42e-9,
                .step = 42,
                .attempt = 2,
                .mode = Mode::kTrial,
                .commit_previous = true,
                .wanted = {Field::kShearStress, Field::kOutcome}},
      step_columns(3));
  add("downscale_absent_nodes_open",
      Downscale{.dt_s = 1e-9, .mode = Mode::kAdvance, .absent_nodes = AbsentNodes::kOpen}, step_columns(2));
  add("downscale_part", Downscale{.dt_s = 1e-9, .part = 2, .parts = 3}, step_columns(2));
  add("commit", Commit{});
  add("rollback", Rollback{});
  add("close_session", CloseSession{.reason = "done"});
  add("server_status", ServerStatusQuery{});
  add("open_session_to_resume", OpenSession{.scene = kScene, .session_id = session_id(), .resume_token = session_id()},
      std::move(more_nodes));
  add("open_session_that_checks_closure",
      OpenSession{.scene = kScene, .session_id = session_id(), .check_closure = true, .idle_limit_s = 3600});
  add("resume_session", ResumeSession{.resume_token = session_id(), .claim = 3, .claimant = 77});
  add("mark", Mark{.name = "dump 17"});
  add("checkpoint", Checkpoint{});
  add("drain", Drain{.exit = true, .within_s = 18});
  add("inspect", Inspect{.after = session_id(), .top = Top::kMolten, .count = 5});
  add("rollback_to_mark", Rollback{.to_mark = "dump 17"});
  const auto some_nodes = [&](std::span<const Field> fields) {
    Batch batch = Batch::of(fields, 2);
    batch.u64(Field::kNodeId)[1] = 1ULL << 63;
    for (double& value : batch.f64(Field::kInitialTemperature)) value = 300.0;
    return batch;
  };
  add("open_session_in_a_domain", OpenSession{.scene = kScene, .session_id = session_id(), .domain = "crash 7"});
  add("downscale_all_or_nothing", Downscale{.dt_s = 1e-9, .policy = Policy::kAllOrNothing}, step_columns(2));
  add("register_nodes", RegisterNodes{}, some_nodes(opening));
  add("retire_nodes", RetireNodes{}, some_nodes(std::span(opening, 1)));
  add("offer_nodes", OfferNodes{.transfer_id = session_id()}, some_nodes(std::span(opening, 1)));
  add("accept_nodes", AcceptNodes{.transfer_id = session_id()});
  const Field of_profile[] = {Field::kNodeId, Field::kPressure};
  add("read_profiles", ReadProfiles{}, some_nodes(of_profile));
  return all;
}

inline std::vector<std::pair<std::string, Reply>> replies() {
  std::vector<std::pair<std::string, Reply>> all;
  const auto add = [&](const char* name, auto body) -> Reply& {
    all.emplace_back(name, enveloped<Reply>(std::move(body)));
    return all.back().second;
  };
  add("welcome", Welcome{.protocol_major = 1,
                         .protocol_minor = 0,
                         .server_version = "0.1.0",
                         .limits = {1, 2, 3, 4, 5, 6, 7},
                         .capabilities = {"trial", "mask"},
                         .durability = "none",
                         .access = "key"});
  add("session_opened", SessionOpened{.effective_scene = kScene,
                                      .bytes_per_node = 16384,
                                      .warnings = {"thin layer", "weak hard side"},
                                      .strategy = Strategy::kForceDriven,
                                      .tangential_components = 2,
                                      .required_columns = {Field::kVelocityJump, Field::kPressure},
                                      .optional_columns = {Field::kSoftPlasticStrainRate},
                                      .reply_columns = {Field::kShearStress, Field::kRegime},
                                      .columns_on_request = {Field::kErrorEstimate},
                                      .scene_name = "sample"});
  Reply& upscale =
      add("upscale", Upscale{.nodes = 5, .state_version = 6, .solver_ns = 7, .service_ns = 8, .flagged_nodes = 2});
  upscale.batch = answer_columns(5);
  upscale.replayed = true;
  add("upscale_with_closure", Upscale{.nodes = 5,
                                      .state_version = 1,
                                      .largest_closure_m_per_s = 2.5,
                                      .closure_node = 1ULL << 40,
                                      .layer_time_s = 2e-9,
                                      .warnings = {"dt_s: long", "time_s: grew"}});
  add("committed", Committed{.state_version = 9});
  add("rolled_back", RolledBack{.state_version = 10});
  add("session_closed", SessionClosed{.requests = 11, .node_steps = 12, .solver_ns = 13});
  add("server_status", ServerStatus{1, 2, 3, 4, 5, 6, 7, 8, 9, 10, "0.1.0"});
  Reply& resumed =
      add("session_resumed", SessionResumed{.session = {.effective_scene = kScene, .bytes_per_node = 16384},
                                            .last_sequence = 14,
                                            .state_version = 15,
                                            .trial_stands = true,
                                            .claim = 2,
                                            .offers = {session_id(), session_id()}});
  const Field node_id[] = {Field::kNodeId};
  resumed.batch = Batch::of(node_id, 2);
  Reply& accepted = add("nodes_changed", NodesChanged{.nodes = 17});
  accepted.batch = Batch::of(node_id, 3);
  Reply& back = add("rolled_back_to_mark", RolledBack{.state_version = 3});
  back.batch = Batch::of(node_id, 1);
  add("marked", Marked{.state_version = 16, .names = {"dump 16", "dump 17"}});
  add("checkpointed", Checkpointed{.bytes = 17, .duration_ns = 18});
  add("draining", Draining{.sessions = 19});
  Reply& inspected = add("inspected", Inspected{.sessions = {{.session_id = session_id(),
                                                              .name = "sample",
                                                              .identity = "uid 1000",
                                                              .nodes = 20,
                                                              .last_sequence = 21,
                                                              .state_version = 22,
                                                              .trial_stands = true,
                                                              .age_ns = 23,
                                                              .idle_ns = 24,
                                                              .state_bytes = 25,
                                                              .requests = 26,
                                                              .node_steps = 27,
                                                              .solver_ns = 28}},
                                                .more = true,
                                                .matching = 29});
  inspected.batch = answer_columns(2);
  add("inspected_in_a_domain",
      Inspected{.sessions = {{.session_id = session_id(), .domain = "run 7", .idle_limit_s = 3600}}});
  ServerStatus full{1, 2, 3, 4, 5, 6, 7, 8, 9, 10, "0.1.0"};
  full.histograms = {{.name = "request", .verb = "downscale", .counts = {0, 300, 2}, .sum_ns = 31}};
  full.refusals = {{.code = 301, .count = 32}};
  full.journal_records = 33;
  full.journal_bytes = 34;
  full.recovered_requests = 35;
  full.checkpoints = 36;
  full.checkpoints_failed = 37;
  full.checkpoint_bytes = 38;
  full.checkpoint_age_ns = 39;
  full.messages_received = 40;
  full.messages_sent = 41;
  full.answers_undeliverable = 42;
  full.messages_without_user = 43;
  full.connections_admitted = 44;
  full.connections_refused = 45;
  full.admitting = true;
  full.draining = true;
  full.resident_bytes = 46;
  full.open_files = 47;
  full.max_open_files = 48;
  add("server_status_in_full", std::move(full));
  const Field of_vertices[] = {Field::kNodeId, Field::kPosition, Field::kLayerTemperature};
  add("profiles", Profiles{.nodes = 2, .vertices = 3, .state_version = 49}).batch = Batch::of(of_vertices, 6);
  Reply& refusal = add("refusal", std::monostate{});
  refusal.status = {.code = Code::kInvalidValue,
                    .text = "pressure_pa of node 7 is nan, expected a finite number",
                    .remedy = "Mend the host's pressure.",
                    .field = "pressure_pa",
                    .node_ids = {7, 1ULL << 63},
                    .last_sequence = 41};
  return all;
}

inline Request request(std::string_view wanted) {
  auto all = requests();
  for (auto& [name, message] : all)
    if (name == wanted) return std::move(message);
  throw std::invalid_argument("no sample request " + std::string(wanted));
}

inline Reply reply(std::string_view wanted) {
  auto all = replies();
  for (auto& [name, message] : all)
    if (name == wanted) return std::move(message);
  throw std::invalid_argument("no sample reply " + std::string(wanted));
}

}  // namespace shearbus::wire::samples
