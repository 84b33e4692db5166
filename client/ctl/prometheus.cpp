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

// Collects metric families in the order in which they are printed.
class Metrics {
 public:
  MetricFamily& add(const std::string& name, MetricType type, const char* help) {
    return families_.emplace_back(MetricFamily{.name = "shearbus_" + name, .help = help, .type = type, .metric = {}});
  }
  void gauge(const char* name, const char* help, double value) {
    add(name, MetricType::Gauge, help).metric.emplace_back().gauge.value = value;
  }
  void counter(const char* name, const char* help, double value) {
    add(name, MetricType::Counter, help).metric.emplace_back().counter.value = value;
  }
  std::vector<MetricFamily> families() && { return std::move(families_); }

 private:
  std::vector<MetricFamily> families_;
};

ClientMetric& labelled(MetricFamily& family, const char* label, const std::string& value) {
  ClientMetric& metric = family.metric.emplace_back();
  metric.label.push_back({label, value});
  return metric;
}

ClientMetric as_metric(const wire::Histogram& histogram) {
  ClientMetric metric;
  if (!histogram.verb.empty()) metric.label.push_back({"verb", histogram.verb});
  std::uint64_t count = 0;
  std::uint64_t bound_ns = wire::kHistogramBaseNs;
  for (std::size_t i = 0; i < histogram.counts.size(); ++i, bound_ns *= 2) {
    count += histogram.counts[i];
    const bool last = i + 1 == histogram.counts.size();
    metric.histogram.bucket.push_back(
        {.cumulative_count = count, .upper_bound = last ? std::numeric_limits<double>::infinity() : seconds(bound_ns)});
  }
  metric.histogram.sample_count = count;
  metric.histogram.sample_sum = seconds(histogram.sum_ns);
  return metric;
}

struct Known {
  const char* name;
  const char* help;
};
constexpr Known kHistograms[] = {{"request", "From a request's arrival to its answer"},
                                 {"solver", "In the layers, of a step"},
                                 {"journal_append", "Writing a request to the journal"},
                                 {"journal_sync", "Bringing the journal to the disk"},
                                 {"checkpoint", "Writing a checkpoint and reading it back"}};

double number(std::uint64_t value) {
  return static_cast<double>(value);
}

// What only operators are told.
void add_server_wide(const wire::ServerStatus& s, Metrics& metrics) {
  metrics.counter("messages_received_total", "Messages off the socket", number(s.messages_received));
  metrics.counter("messages_sent_total", "Answers to the socket", number(s.messages_sent));
  metrics.counter("answers_undeliverable_total", "Answers whose peer had left or did not read",
                  number(s.answers_undeliverable));
  metrics.counter("messages_without_user_total", "Messages dropped: nobody had let their peer in",
                  number(s.messages_without_user));
  metrics.counter("connections_admitted_total", "Connections let in", number(s.connections_admitted));
  metrics.counter("connections_refused_total", "Connections refused", number(s.connections_refused));
  metrics.gauge("admitting", "1: who decides about connections is there", s.admitting ? 1 : 0);
  metrics.counter("journal_records_total", "Requests written to the journal", number(s.journal_records));
  metrics.counter("journal_bytes_total", "Bytes written to the journal", number(s.journal_bytes));
  metrics.gauge("recovered_requests", "Replayed from the journal at the start", number(s.recovered_requests));
  metrics.counter("checkpoints_total", "Checkpoints written", number(s.checkpoints));
  metrics.counter("checkpoints_failed_total", "Checkpoints that could not be written", number(s.checkpoints_failed));
  metrics.gauge("checkpoint_bytes", "Size of the last checkpoint", number(s.checkpoint_bytes));
  if (s.checkpoint_age_ns != 0)
    metrics.gauge("checkpoint_age_seconds", "Since the last checkpoint", seconds(s.checkpoint_age_ns));
  metrics.gauge("longest_turn_seconds", "Longest processor time of a request without a look at the others",
                seconds(s.longest_turn_ns));
  metrics.gauge("resident_bytes", "Resident memory of the process", number(s.resident_bytes));
  metrics.gauge("open_files", "Files the process has open, connections among them", number(s.open_files));
  metrics.gauge("max_open_files", "Files it may open", number(s.max_open_files));
}

std::vector<MetricFamily> families_of(const Told& told) {
  const wire::ServerStatus& s = told.status;
  Metrics metrics;
  labelled(metrics.add("build_info", MetricType::Gauge, "The server's version"), "version", s.server_version)
      .gauge.value = 1;
  metrics.gauge("uptime_seconds", "Since the start of the server", seconds(s.uptime_ns));
  metrics.gauge("sessions", "Open sessions", number(s.sessions));
  metrics.gauge("nodes", "Nodes of all sessions", number(s.nodes));
  MetricFamily& regimes =
      metrics.add("regime_nodes", MetricType::Gauge, "Nodes by the regime of their committed state");
  for (const auto& [regime, nodes] : regimes_of(s)) labelled(regimes, "regime", regime).gauge.value = number(nodes);
  metrics.gauge("state_bytes", "Memory of all states", number(s.state_bytes));
  metrics.gauge("draining", "1: no new sessions", s.draining ? 1 : 0);
  metrics.counter("requests_total", "Requests that were answered", number(s.requests));
  metrics.counter("replayed_total", "Answered from the kept reply", number(s.replayed));
  metrics.counter("refused_total", "Requests that were refused", number(s.refused));
  MetricFamily& refusals = metrics.add("refusals_total", MetricType::Counter, "Requests that were refused, by code");
  for (const wire::Refusals& refused : s.refusals)
    labelled(refusals, "code", name(static_cast<wire::Code>(refused.code))).counter.value = number(refused.count);
  metrics.counter("node_steps_total", "Steps of single nodes", number(s.node_steps));
  if (told.is_operator) add_server_wide(s, metrics);
  for (const Known& known : kHistograms) {
    std::vector<ClientMetric> found;
    for (const wire::Histogram& histogram : s.histograms)
      if (histogram.name == known.name) found.push_back(as_metric(histogram));
    if (found.empty()) continue;
    metrics.add(std::string(known.name) + "_seconds", MetricType::Histogram, known.help).metric = std::move(found);
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
