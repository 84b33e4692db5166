#include <fmt/format.h>

#include <cstddef>
#include <cstdint>
#include <string>

#include "client/ctl/operations.hpp"

namespace shearbus::ctl {
namespace {

double seconds(std::uint64_t ns) {
  return 1e-9 * static_cast<double>(ns);
}

class Text {
 public:
  void gauge(const char* name, const char* help, double value) { single(name, "gauge", help, value); }
  void counter(const char* name, const char* help, double value) { single(name, "counter", help, value); }
  void head(const char* name, const char* type, const char* help) {
    text_ += fmt::format("# HELP shearbus_{0} {2}\n# TYPE shearbus_{0} {1}\n", name, type, help);
  }
  void line(const std::string& name, double value) { text_ += fmt::format("shearbus_{} {}\n", name, value); }
  const std::string& text() const { return text_; }

 private:
  void single(const char* name, const char* type, const char* help, double value) {
    head(name, type, help);
    line(name, value);
  }
  std::string text_;
};

void put(Text& text, const wire::Histogram& histogram) {
  const std::string label = histogram.verb.empty() ? "" : fmt::format("verb=\"{}\"", histogram.verb);
  const std::string before_le = label.empty() ? "" : label + ",";
  std::uint64_t count = 0;
  std::uint64_t bound_ns = wire::kHistogramBaseNs;
  for (std::size_t i = 0; i < histogram.counts.size(); ++i, bound_ns *= 2) {
    count += histogram.counts[i];
    const bool last = i + 1 == histogram.counts.size();
    const std::string bound = last ? "+Inf" : fmt::format("{:.9g}", seconds(bound_ns));
    text.line(fmt::format("{}_seconds_bucket{{{}le=\"{}\"}}", histogram.name, before_le, bound),
              static_cast<double>(count));
  }
  const std::string labels = label.empty() ? "" : "{" + label + "}";
  text.line(histogram.name + "_seconds_sum" + labels, seconds(histogram.sum_ns));
  text.line(histogram.name + "_seconds_count" + labels, static_cast<double>(count));
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

}  // namespace

std::string prometheus_text(const wire::ServerStatus& s) {
  Text text;
  const auto number = [](auto value) { return static_cast<double>(value); };
  text.head("build_info", "gauge", "The server's version");
  text.line(fmt::format("build_info{{version=\"{}\"}}", s.server_version), 1);
  text.gauge("uptime_seconds", "Since the start of the server", seconds(s.uptime_ns));
  text.gauge("sessions", "Open sessions", number(s.sessions));
  text.gauge("nodes", "Nodes of all sessions", number(s.nodes));
  text.gauge("state_bytes", "Memory of all states", number(s.state_bytes));
  text.gauge("draining", "1: no new sessions", s.draining ? 1 : 0);
  text.counter("requests_total", "Requests that were answered", number(s.requests));
  text.counter("replayed_total", "Answered from the kept reply", number(s.replayed));
  text.counter("refused_total", "Requests that were refused", number(s.refused));
  text.head("refusals_total", "counter", "Requests that were refused, by code");
  for (const wire::Refusals& refusals : s.refusals)
    text.line(fmt::format("refusals_total{{code=\"{}\"}}", name(static_cast<wire::Code>(refusals.code))),
              number(refusals.count));
  text.counter("node_steps_total", "Steps of single nodes", number(s.node_steps));
  text.counter("messages_received_total", "Messages off the socket", number(s.messages_received));
  text.counter("messages_sent_total", "Answers to the socket", number(s.messages_sent));
  text.counter("answers_undeliverable_total", "Answers whose peer had left or did not read",
               number(s.answers_undeliverable));
  text.counter("messages_without_user_total", "Messages dropped: nobody had let their peer in",
               number(s.messages_without_user));
  text.counter("connections_admitted_total", "Connections let in", number(s.connections_admitted));
  text.counter("connections_refused_total", "Connections refused", number(s.connections_refused));
  text.gauge("admitting", "1: who decides about connections is there", s.admitting ? 1 : 0);
  text.counter("journal_records_total", "Requests written to the journal", number(s.journal_records));
  text.counter("journal_bytes_total", "Bytes written to the journal", number(s.journal_bytes));
  text.gauge("recovered_requests", "Replayed from the journal at the start", number(s.recovered_requests));
  text.counter("checkpoints_total", "Checkpoints written", number(s.checkpoints));
  text.counter("checkpoints_failed_total", "Checkpoints that could not be written", number(s.checkpoints_failed));
  text.gauge("checkpoint_bytes", "Size of the last checkpoint", number(s.checkpoint_bytes));
  if (s.checkpoint_age_ns != 0)
    text.gauge("checkpoint_age_seconds", "Since the last checkpoint", seconds(s.checkpoint_age_ns));
  text.gauge("resident_bytes", "Resident memory of the process", number(s.resident_bytes));
  text.gauge("open_files", "Files the process has open, connections among them", number(s.open_files));
  text.gauge("max_open_files", "Files it may open", number(s.max_open_files));
  for (const Known& known : kHistograms) {
    bool first = true;
    for (const wire::Histogram& histogram : s.histograms) {
      if (histogram.name != known.name) continue;
      if (first) text.head((std::string(known.name) + "_seconds").c_str(), "histogram", known.help);
      first = false;
      put(text, histogram);
    }
  }
  return text.text();
}

}  // namespace shearbus::ctl
