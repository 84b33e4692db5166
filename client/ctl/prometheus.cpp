#include <fmt/format.h>
#include <prometheus/collectable.h>
#include <prometheus/exposer.h>
#include <prometheus/text_serializer.h>

#include <algorithm>
#include <csignal>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <future>
#include <iterator>
#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "client/ctl/operations.hpp"
#include "proto/wire/numbers.hpp"

namespace shearbus::ctl {
namespace {

using prometheus::ClientMetric;
using prometheus::MetricFamily;
using prometheus::MetricType;

// Collects metric families in the order in which they are printed: those of fields of the server's status by the names
// of the fields, as a time in ns NAME_ns that is NAME_seconds here, and counters with _total behind.
class Metrics {
 public:
  explicit Metrics(const Json& status) : status_(status) {}
  MetricFamily& add(const std::string& name, MetricType type, const char* help) {
    return families_.emplace_back(MetricFamily{.name = "shearbus_" + name, .help = help, .type = type, .metric = {}});
  }
  void gauge(const std::string& field, const char* help) {
    const Json& value = status_.at(field);
    const bool time = field.ends_with("_ns");
    MetricFamily& family = add(time ? field.substr(0, field.size() - 2) + "seconds" : field, MetricType::Gauge, help);
    family.metric.emplace_back().gauge.value = value.is_boolean() ? value.get<bool>()
                                               : time             ? seconds(value.get<std::uint64_t>())
                                                                  : value.get<double>();
  }
  void counter(const std::string& field, const char* help) {
    add(field + "_total", MetricType::Counter, help).metric.emplace_back().counter.value =
        status_.at(field).get<double>();
  }
  std::vector<MetricFamily> families() && { return std::move(families_); }

 private:
  const Json& status_;
  std::vector<MetricFamily> families_;
};

ClientMetric& labelled(MetricFamily& family, const char* label, const std::string& value) {
  ClientMetric& metric = family.metric.emplace_back();
  metric.label.push_back({label, value});
  return metric;
}

ClientMetric as_metric(const Json& histogram) {
  ClientMetric metric;
  if (const std::string verb = text(histogram, "verb"); !verb.empty()) metric.label.push_back({"verb", verb});
  std::uint64_t count = 0;
  std::uint64_t bound_ns = wire::kHistogramBaseNs;
  const auto counts = histogram.at("counts").get<std::vector<std::uint64_t>>();
  for (std::size_t i = 0; i < counts.size(); ++i, bound_ns *= 2) {
    count += counts[i];
    const bool last = i + 1 == counts.size();
    metric.histogram.bucket.push_back(
        {.cumulative_count = count, .upper_bound = last ? std::numeric_limits<double>::infinity() : seconds(bound_ns)});
  }
  metric.histogram.sample_count = count;
  metric.histogram.sample_sum = seconds(histogram, "sum_ns");
  return metric;
}

constexpr std::pair<const char*, const char*> kHistograms[] = {
    {"request", "From a request's arrival to its answer"},
    {"solver", "In the layers, of a step"},
    {"journal_append", "Writing a request to the journal"},
    {"journal_sync", "Bringing the journal to the disk"},
    {"checkpoint", "Writing a checkpoint and reading it back"}};

// What only operators are told.
void add_server_wide(const Json& status, Metrics& metrics) {
  metrics.counter("messages_received", "Messages off the socket");
  metrics.counter("messages_sent", "Answers to the socket");
  metrics.counter("answers_undeliverable", "Answers whose peer had left or did not read");
  metrics.counter("messages_without_user", "Messages dropped: nobody had let their peer in");
  metrics.counter("connections_admitted", "Connections let in");
  metrics.counter("connections_refused", "Connections refused");
  metrics.gauge("admitting", "1: who decides about connections is there");
  metrics.counter("journal_records", "Requests written to the journal");
  metrics.counter("journal_bytes", "Bytes written to the journal");
  metrics.gauge("recovered_requests", "Replayed from the journal at the start");
  metrics.counter("checkpoints", "Checkpoints written");
  metrics.counter("checkpoints_failed", "Checkpoints that could not be written");
  metrics.gauge("checkpoint_bytes", "Size of the last checkpoint");
  if (count(status, "checkpoint_age_ns") != 0) metrics.gauge("checkpoint_age_ns", "Since the last checkpoint");
  metrics.gauge("longest_turn_ns", "Longest processor time of a request without a look at the others");
  metrics.gauge("resident_bytes", "Resident memory of the process");
  metrics.gauge("open_files", "Files the process has open, connections among them");
  metrics.gauge("max_open_files", "Files it may open");
}

std::vector<MetricFamily> families_of(const Told& told) {
  const Json& status = told.status;
  Metrics metrics(status);
  labelled(metrics.add("build_info", MetricType::Gauge, "The server's version"), "version",
           text(status, "server_version"))
      .gauge.value = 1;
  metrics.gauge("uptime_ns", "Since the start of the server");
  metrics.gauge("sessions", "Open sessions");
  metrics.gauge("nodes", "Nodes of all sessions");
  MetricFamily& regimes =
      metrics.add("regime_nodes", MetricType::Gauge, "Nodes by the regime of their committed state");
  for (const auto& [regime, nodes] : regimes_of(status))
    labelled(regimes, "regime", regime).gauge.value = static_cast<double>(nodes);
  metrics.gauge("state_bytes", "Memory of all states");
  metrics.gauge("draining", "1: no new sessions");
  metrics.counter("requests", "Requests that were answered");
  metrics.counter("replayed", "Answered from the kept reply");
  metrics.counter("refused", "Requests that were refused");
  MetricFamily& refusals = metrics.add("refusals_total", MetricType::Counter, "Requests that were refused, by code");
  for (const Json& refused : status.at("refusals"))
    labelled(refusals, "code", name(static_cast<Code>(count(refused, "code")))).counter.value =
        refused.at("count").get<double>();
  metrics.counter("node_steps", "Steps of single nodes");
  if (told.is_operator) add_server_wide(status, metrics);
  for (const auto& [known, help] : kHistograms) {
    std::vector<ClientMetric> found;
    for (const Json& histogram : status.at("histograms"))
      if (text(histogram, "name") == known) found.push_back(as_metric(histogram));
    if (found.empty()) continue;
    metrics.add(std::string(known) + "_seconds", MetricType::Histogram, help).metric = std::move(found);
  }
  return std::move(metrics).families();
}

// Asks the servers at each scrape and gives their metrics the label `server`.
class Servers : public prometheus::Collectable {
 public:
  Servers(std::function<ServerList()> list, StatusOf status_of)
      : list_(std::move(list)), status_of_(std::move(status_of)) {}

  std::vector<MetricFamily> Collect() const override {
    std::vector<MetricFamily> all = {
        {.name = "shearbus_up", .help = "1: the server answers", .type = MetricType::Gauge, .metric = {}}};
    std::vector<std::pair<std::string, std::future<Told>>> asked;
    for (const auto& [name, endpoint] : servers())
      asked.emplace_back(name, std::async(std::launch::async, status_of_, endpoint));
    for (auto& [name, answer] : asked) {
      labelled(all.front(), "server", name);
      try {
        add(families_of(answer.get()), name, all);
        all.front().metric.back().gauge.value = 1;
      } catch (const std::exception&) {
        // The server does not answer: up is 0.
      }
    }
    return all;
  }

 private:
  std::vector<std::pair<std::string, std::string>> servers() const {
    try {
      return list_();
    } catch (const std::exception&) {
      return {};  // a directory without endpoint files: no server runs now
    }
  }

  // A family has one place in the text, with the metrics of all servers.
  static void add(std::vector<MetricFamily> families, const std::string& server, std::vector<MetricFamily>& all) {
    for (MetricFamily& family : families) {
      for (ClientMetric& metric : family.metric) metric.label.push_back({"server", server});
      const auto place = std::find_if(all.begin(), all.end(), [&](const auto& f) { return f.name == family.name; });
      if (place == all.end())
        all.push_back(std::move(family));
      else
        std::move(family.metric.begin(), family.metric.end(), std::back_inserter(place->metric));
    }
  }

  std::function<ServerList()> list_;
  StatusOf status_of_;
};

}  // namespace

std::string prometheus_text(const Told& told) {
  return prometheus::TextSerializer().Serialize(families_of(told));
}

// Refuses what the HTTP server would take for a port of every address of the machine, or for several ports.
static void check_address(const std::string& address) {
  const std::size_t colon = address.rfind(':');
  const std::string port = colon == std::string::npos ? address : address.substr(colon + 1);
  constexpr std::uint64_t kLastPort = 65535;
  const bool is_port = wire::count_of(port, kLastPort).has_value();
  if (is_port && colon != std::string::npos && colon != 0 && address.find(',') == std::string::npos) return;
  throw std::runtime_error(
      fmt::format("cannot listen at {0}: expected ADDRESS:PORT, with a port up to 65535. For this machine alone: "
                  "127.0.0.1:{1}; for every network that the "
                  "machine is in, where nothing protects the metrics: 0.0.0.0:{1}",
                  address, is_port ? port : "9464"));
}

void serve_metrics(const std::string& address, std::function<ServerList()> servers, StatusOf status_of) {
  // Blocked before any thread exists, so that only this thread gets them.
  sigset_t stop;
  sigemptyset(&stop);
  sigaddset(&stop, SIGTERM);
  sigaddset(&stop, SIGINT);
  pthread_sigmask(SIG_BLOCK, &stop, nullptr);
  check_address(address);
  std::optional<prometheus::Exposer> exposer;
  try {
    exposer.emplace(address);
  } catch (const std::exception&) {  // which does not say why
    throw std::runtime_error(
        fmt::format("cannot listen at {}: the port is in use or not for this user, or the address is "
                    "not of this machine; choose others, for instance 127.0.0.1:9465",
                    address));
  }
  const auto collected = std::make_shared<Servers>(std::move(servers), std::move(status_of));
  exposer->RegisterCollectable(collected);
  fmt::print("metrics at port {}, path /metrics\n", exposer->GetListeningPorts().front());
  static_cast<void>(std::fflush(stdout));
  int received = 0;
  sigwait(&stop, &received);
}

}  // namespace shearbus::ctl
