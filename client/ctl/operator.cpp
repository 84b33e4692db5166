#include "client/ctl/operator.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <type_traits>

#include "client/src/program_door.hpp"
#include "proto/wire/field_rows.hpp"
#include "proto/wire/text.hpp"

namespace shearbus::ctl {
namespace {

// Sets the fields of a message from a JSON object: those that it has.
class RowsFromJson {
 public:
  explicit RowsFromJson(const nlohmann::json& json) : json_(json) {}

  template <typename T>
  void operator()(std::uint32_t, const char* name, T&& row) const {
    const auto found = json_.find(name);
    if (found == json_.end()) return;
    if constexpr (requires { row.value; } && !wire::HasRows<std::remove_cvref_t<T>>)
      take(row.value, *found);  // one with a rule
    else
      take(row, *found);
  }

 private:
  template <typename T>
  static void take(T& value, const nlohmann::json& json) {
    if constexpr (wire::HasRows<T>)
      T::fields(RowsFromJson(json), value);
    else if constexpr (std::is_enum_v<T>)
      value = static_cast<T>(json.get<std::uint64_t>());
    else
      value = json.get<T>();
  }
  static void take(wire::Id& id, const nlohmann::json& json) {
    const auto digits = json.get<std::string>();
    for (std::size_t i = 0; i < id.size() && 2 * i + 1 < digits.size(); ++i)
      id[i] = static_cast<std::uint8_t>(std::stoul(digits.substr(2 * i, 2), nullptr, 16));
  }
  template <typename T>
  static void take(std::vector<T>& values, const nlohmann::json& json) {
    values.clear();
    for (const nlohmann::json& element : json) take(values.emplace_back(), element);
  }

  const nlohmann::json& json_;
};

template <typename Message>
Message message_of(const nlohmann::json& json) {
  Message message;
  Message::fields(RowsFromJson(json), message);
  return message;
}

shearbus_question question_of(int what) {
  shearbus_question question = SHEARBUS_QUESTION_INIT;
  question.what = what;
  return question;
}

}  // namespace

struct Operator::Impl {
  explicit Impl(const shearbus::Options& options) : door(options) {
    welcome = message_of<wire::Welcome>(nlohmann::json::parse(door.ask(SHEARBUS_ASK_WELCOME)));
  }
  nlohmann::json ask(const shearbus_question& question) {
    return nlohmann::json::parse(asking([&] { return door.ask(question); }));
  }
  template <typename Message>
  Message ask_for(int what) {
    return message_of<Message>(ask(question_of(what)));
  }

  shearbus::Operator door;
  wire::Welcome welcome;
};

Operator::Operator(const files::ServerAddress& server, double deadline_s, bool once) {
  shearbus::Options options = options_of("shearbus-ctl", server);
  options.connect_deadline_s = options.reply_deadline_s = deadline_s;
  if (once) options.retry_after_s = deadline_s;
  impl_ = asking([&] { return std::make_unique<Impl>(options); });
}
Operator::Operator(Operator&&) noexcept = default;
Operator& Operator::operator=(Operator&&) noexcept = default;
Operator::~Operator() = default;

const wire::Welcome& Operator::welcome() const {
  return impl_->welcome;
}
wire::ServerStatus Operator::server_status() {
  return impl_->ask_for<wire::ServerStatus>(SHEARBUS_ASK_STATUS);
}
std::vector<wire::SessionInfo> Operator::sessions() {
  return impl_->ask_for<wire::Inspected>(SHEARBUS_ASK_SESSIONS).sessions;
}
wire::Checkpointed Operator::checkpoint() {
  return impl_->ask_for<wire::Checkpointed>(SHEARBUS_ASK_CHECKPOINT);
}

wire::Draining Operator::drain(bool exit, std::uint64_t within_s) {
  shearbus_question question = question_of(SHEARBUS_ASK_DRAIN);
  question.exit = exit ? 1 : 0;
  question.within_s = within_s;
  return message_of<wire::Draining>(impl_->ask(question));
}

wire::SessionClosed Operator::close(const wire::SessionInfo& session) {
  const std::string id = wire::hexadecimal(session.session_id);
  shearbus_question question = question_of(SHEARBUS_ASK_CLOSE);
  question.session = id.c_str();
  question.last_sequence = session.last_sequence;
  return message_of<wire::SessionClosed>(impl_->ask(question));
}

TopNodes Operator::top_nodes(const wire::SessionId& session, wire::Top by, std::uint32_t count) {
  const std::string id = wire::hexadecimal(session);
  shearbus_question question = question_of(SHEARBUS_ASK_TOP);
  question.session = id.c_str();
  question.top = static_cast<int>(by);
  question.count = count;
  const nlohmann::json json = impl_->ask(question);
  TopNodes top{.session = message_of<wire::SessionInfo>(json.at("session")), .matching = json.at("matching")};
  const auto take = [&]<typename T>(wire::Field column, std::vector<T>& values) {
    if (json.contains(wire::name(column))) values = json[wire::name(column)].get<std::vector<T>>();
  };
  take(wire::Field::kNodeId, top.node_ids);
  take(wire::Field::kInterfaceTemperature, top.interface_temperature_k);
  take(wire::Field::kShearStress, top.shear_stress_pa);
  take(wire::Field::kSlidingVelocity, top.sliding_velocity_m_per_s);
  take(wire::Field::kRegime, top.regime);
  return top;
}

CheckedScene check_scene(const std::string& text, const std::string& file) {
  shearbus::Options options = options_of("shearbus-ctl", {});
  options.scene_text = text;
  options.scene_name = file;
  options.log = [](const std::string&) {};  // the caller tells the warnings
  return asking([&] {
    shearbus::Session session(options, {0});
    CheckedScene checked{.effective_scene = session.effective_scene(),
                         .warnings = lines_of(session.warnings()),
                         .bytes_per_node = session.info().bytes_per_node};
    session.close();
    return checked;
  });
}

KeyPair make_key_pair() {
  char public_key[SHEARBUS_KEY_BYTES], secret_key[SHEARBUS_KEY_BYTES];
  asking([&] { shearbus::call(shearbus_make_keys, public_key, secret_key); });
  return {.public_key = public_key, .secret_key = secret_key};
}

}  // namespace shearbus::ctl
