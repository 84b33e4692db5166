#include "client/ctl/operator.hpp"

#include "client/src/program_door.hpp"

namespace shearbus::ctl {

// In this file alone: with its header shearbus::wire is also a name of the scene's messages, which main.cpp knows.
struct Operator::Door {
  shearbus::Operator server;
};

Operator::Operator(const files::ServerAddress& server, double deadline_s, bool once) {
  shearbus::Options options = options_of("shearbus-ctl", server);
  options.connect_deadline_s = options.reply_deadline_s = deadline_s;
  if (once) options.retry_after_s = deadline_s;
  door_ = asking([&] { return std::make_shared<Door>(Door{shearbus::Operator(options)}); });
  welcome_ = ask(SHEARBUS_ASK_WELCOME);
}

Json Operator::ask(const shearbus_question& question) {
  return Json::parse(asking([&] { return door_->server.ask(question); }));
}

Json Operator::ask(int what) {
  shearbus_question question = SHEARBUS_QUESTION_INIT;
  question.what = what;
  return ask(question);
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
