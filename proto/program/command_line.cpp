#include "proto/program/command_line.hpp"

#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdio>
#include <memory>
#include <regex>
#include <sstream>

#include "proto/program/program.hpp"
#include "proto/wire/limits.hpp"
#include "proto/wire/numbers.hpp"
#include "proto/wire/text.hpp"

namespace shearbus::program {
namespace {

constexpr std::size_t kNameColumn = 28;  // width of the column with the names of options
constexpr std::size_t kWidth = 100;      // of the help

// Returns an entry of the help: the names, then the description, wrapped, in a column of its own.
std::string entry(const std::string& names, const std::string& description) {
  std::string out = "  " + names;
  std::size_t column = out.size();
  if (column + 2 > kNameColumn) {
    out += '\n';
    column = 0;
  }
  out.append(kNameColumn - column, ' ');
  column = kNameColumn;
  std::istringstream words(description);
  for (std::string word; words >> word;) {
    if (column > kNameColumn && column + 1 + word.size() > kWidth) {
      out += '\n' + std::string(kNameColumn, ' ');
      column = kNameColumn;
    }
    if (column > kNameColumn) {
      out += ' ';
      ++column;
    }
    out += word;
    column += word.size();
  }
  return out + '\n';
}

// The name of an option's value in the help. CLI11 appends the descriptions of the option's checks to its type.
std::string value_name(const CLI::Option& option) {
  std::string checks;
  try {
    auto& checked = const_cast<CLI::Option&>(option);  // get_validator() changes nothing, but is not const
    for (int i = 0;; ++i)
      if (const std::string check = checked.get_validator(i)->get_description(); !check.empty()) checks += ":" + check;
  } catch (const CLI::OptionNotFound&) {
    // get_validator(i) throws past the last check, which ends the loop
  }
  std::string type = option.get_type_name();
  if (type.ends_with(checks)) type.resize(type.size() - checks.size());
  constexpr std::array<std::pair<const char*, const char*>, 4> kOwn = {
      {{"UINT", "N"}, {"INT", "N"}, {"FLOAT", "NUMBER"}, {"ENUM", "WORD"}}};
  for (const auto& [theirs, ours] : kOwn)
    if (type == theirs) return ours;
  return type;
}

// What the checks of an option allow, such as "1 to 1000"; empty if they say nothing that a user would read.
std::string allowed_values(const CLI::Option& option) {
  const std::string type = option.get_type_name();
  static const std::regex range(R"(in \[(\S+) - (\S+)\])");
  if (std::smatch found; std::regex_search(type, found, range)) {
    constexpr double kSoLargeThatNobodyMeetsIt = 1e6;
    const double least = std::stod(found[1]), most = std::stod(found[2]);
    return most < kSoLargeThatNobodyMeetsIt ? fmt::format("{:g} to {:g}", least, most)
                                            : fmt::format("from {:g} on", least);
  }
  if (type.find("POSITIVE") != std::string::npos) return "above 0";
  if (type.find("NONNEGATIVE") != std::string::npos) return "from 0 on";
  return {};
}

// Names of options, commands and positionals without type names, defaults of flags and enumerations of values.
class HelpFormatter : public CLI::Formatter {
 public:
  std::string make_option(const CLI::Option* option, bool is_positional) const override {
    std::string names;
    if (is_positional) {
      names = option->get_name(true);
    } else {
      for (const std::string& name : option->get_snames()) names += (names.empty() ? "-" : ", -") + name;
      for (const std::string& name : option->get_lnames()) names += (names.empty() ? "--" : ", --") + name;
      const std::string value = option->get_type_size() != 0 ? value_name(*option) : std::string();
      if (!value.empty()) names += " " + value;
    }
    std::vector<std::string> remarks;
    if (option->get_required() && !is_positional) remarks.emplace_back("required");
    if (const std::string values = allowed_values(*option); !values.empty()) remarks.push_back(values);
    if (option->get_type_size() != 0 && !option->get_default_str().empty())
      remarks.push_back("default " + option->get_default_str());
    for (const CLI::Option* other : option->get_needs()) remarks.push_back("with " + other->get_name());
    return entry(names, remarks.empty() ? option->get_description()
                                        : fmt::format("{} [{}]", option->get_description(), fmt::join(remarks, "; ")));
  }
  std::string make_subcommand(const CLI::App* command) const override {
    return entry(command->get_display_name(true), command->get_description());
  }
  // A group of options of which one is given.
  std::string make_expanded(const CLI::App* group) const override {
    std::string out = "\nOne of these:\n";
    for (const CLI::Option* option : group->get_options())
      if (option != group->get_help_ptr()) out += make_option(option, option->get_positional());
    return out;
  }
  std::string make_description(const CLI::App* app) const override {
    return app->get_description().empty() ? "" : app->get_description() + "\n";
  }
};

// Adds the options of a command, with those of its groups, which are commands without a name.
void add_options_of(const CLI::App& command, std::vector<std::string>& known) {
  for (const CLI::Option* option : command.get_options())
    for (const std::string& name : option->get_lnames()) known.push_back("--" + name);
  for (const CLI::App* group : command.get_subcommands([](const CLI::App* any) { return any->get_name().empty(); }))
    add_options_of(*group, known);
}

// The options and the commands that the user could have meant.
std::vector<std::string> known_words(const CLI::App& app) {
  std::vector<std::string> known;
  add_options_of(app, known);
  for (const CLI::App* chosen : app.get_subcommands()) add_options_of(*chosen, known);
  for (const CLI::App* command : app.get_subcommands([](const CLI::App* any) { return !any->get_name().empty(); }))
    known.push_back(command->get_name());
  return known;
}

std::string nearest_of(const std::string& word, const std::vector<std::string>& known) {
  const std::vector<std::string_view> views(known.begin(), known.end());
  const std::string_view near = wire::nearest(word, views);
  return near.empty() ? "" : fmt::format("; did you mean {}?", near);
}

// The first word that no option or command has taken, preferably one that looks like an option; empty: none.
std::string unknown_word(const CLI::App& app) {
  std::vector<std::string> words = app.remaining(true);
  std::erase(words, "--");
  const auto option = std::ranges::find_if(words, [](const std::string& word) { return word.starts_with("-"); });
  return option != words.end() ? *option : words.empty() ? std::string() : words.front();
}

// What CLI11 says of the value or the number of options, in the words of the help.
std::string in_words_of_the_help(const CLI::App& app, const std::string& text) {
  constexpr std::string_view kValue = ": Value ", kNotIn = " not in range ",
                             kMost = ": At Most 1 required but received ", kOneOf = "Exactly 1 option from [",
                             kGiven = "] is required and ", kIsFile = ": Directory is actually a file: ";
  if (const std::size_t value = text.find(kValue), end = text.rfind(kNotIn); value < end && end != text.npos) {
    const std::string name = text.substr(0, value);
    const CLI::Option* option = app.get_option_no_throw(name);
    for (const CLI::App* chosen : app.get_subcommands())
      if (option == nullptr) option = chosen->get_option_no_throw(name);
    if (option != nullptr)
      return fmt::format("{}: {} is out of range, expected {}", name,
                         text.substr(value + kValue.size(), end - value - kValue.size()), allowed_values(*option));
  }
  if (const std::size_t at = text.find(kMost); at != text.npos)
    return fmt::format("{} is given {} times, expected once", text.substr(0, at), text.substr(at + kMost.size()));
  if (const std::size_t end = text.find(kGiven); text.starts_with(kOneOf) && end != text.npos)
    return fmt::format("expected one of {}: {}", text.substr(kOneOf.size(), end - kOneOf.size()),
                       text.substr(end + kGiven.size()));
  if (const std::size_t at = text.find(kIsFile); at != text.npos)
    return fmt::format("{}: expected a directory, found the file {}", text.substr(0, at),
                       text.substr(at + kIsFile.size()));
  return text;
}

std::string text_of(const CLI::App& app, const CLI::ParseError& fault) {
  const std::string word = unknown_word(app);
  const bool is_option = word.starts_with("-");
  const bool lacks_command = app.get_require_subcommand_min() > 0 && app.get_subcommands().empty();
  const bool is_extra = dynamic_cast<const CLI::ExtrasError*>(&fault) != nullptr;
  const bool is_missing = dynamic_cast<const CLI::RequiredError*>(&fault) != nullptr;
  // An option that is required may be missing because its name is misspelt.
  if (word.empty() || !(is_extra || is_missing)) return in_words_of_the_help(app, fault.what());
  const std::string place =
      app.get_subcommands().empty() ? app.get_name() : app.get_name() + " " + app.get_subcommands().front()->get_name();
  const char* const kind = is_option ? "option" : lacks_command ? "command" : "argument";
  return fmt::format("{} is no {} of {}{}{}", word, kind, place, nearest_of(word, known_words(app)),
                     is_missing && !is_option && !lacks_command ? fmt::format("; {}", fault.what()) : "");
}

// Holds the numbers of a command and its subcommands to the rules of this program's numbers.
void check_numbers(CLI::App& app) {
  for (CLI::Option* option : app.get_options()) {
    const std::string type = option->get_type_name();
    if (type.find("UINT") != std::string::npos)
      whole_number(option);
    else if (type.find("FLOAT") != std::string::npos)
      real_number(option);
  }
  for (CLI::App* command : app.get_subcommands([](CLI::App*) { return true; })) check_numbers(*command);
}

}  // namespace

CLI::Option* whole_number(CLI::Option* option) {
  return option->transform(CLI::Validator(
      [](std::string& text) {
        if (!wire::count_of(text))
          return fmt::format("expected a whole number of digits alone, found {}", wire::in_quotes(text));
        text.erase(0, std::min(text.find_first_not_of('0'), text.size() - 1));  // a leading 0 would mean octal
        return std::string();
      },
      "", "whole"));
}

CLI::Option* real_number(CLI::Option* option) {
  return option->transform(CLI::Validator(
      [](std::string& text) {
        return wire::real_of(text) ? std::string()
                                   : fmt::format("expected a finite number, found {}", wire::in_quotes(text));
      },
      "", "real"));
}

void complete(CLI::App& app, const std::string& program, VersionText version_text, const std::string& footer) {
  app.name(program);
  const auto formatter = std::make_shared<HelpFormatter>();
  app.formatter(formatter);
  const std::string help = "print this help";
  app.get_help_ptr()->description(help);
  for (CLI::App* command : app.get_subcommands([](CLI::App*) { return true; })) {
    command->formatter(formatter);
    if (command->get_help_ptr() != nullptr) command->get_help_ptr()->description(help);
  }
  const bool own_json = app.get_option_no_throw("--json") != nullptr;
  CLI::Option* const version = app.set_version_flag(
      "--version",
      [&app, program, version_text] { return version_text(program, app.get_option("--json")->count() > 0); },
      "print version, commit, compiler, protocol, libraries and width of the registers" +
          std::string(own_json ? "; with --json as JSON" : ""));
  if (!own_json) app.add_flag("--json")->description("as one line of JSON")->needs(version);
  if (!footer.empty()) app.footer(footer);
}

std::optional<int> parse(CLI::App& app, int argc, const char* const* argv, const std::function<void()>& check) {
  constexpr int kWrongCommandLine = 2;
  try {
    check_numbers(app);
    app.parse(argc, argv);
    if (check) check();
  } catch (const CLI::Success& call) {  // --help, --version
    return end_program(app.get_name(), app.exit(call));
  } catch (const CLI::ParseError& fault) {
    complain(fmt::format("{}: {}\nRun {} --help for more information.", app.get_name(),
                         wire::printable(text_of(app, fault), wire::kMaxTextBytes), app.get_name()));
    return kWrongCommandLine;
  }
  return std::nullopt;
}

std::string wrong_word(const std::string& name, const std::string& word, const std::vector<std::string>& known) {
  const std::vector<std::string> all_but_last(known.begin(), known.empty() ? known.end() : known.end() - 1);
  return fmt::format("{}: expected {}{}{}, found {}{}", name, fmt::join(all_but_last, ", "),
                     all_but_last.empty() ? "" : " or ", known.empty() ? "" : known.back(), word,
                     nearest_of(word, known));
}

CLI::Option* add_choice(CLI::App& app, const std::string& name, std::string& value,
                        const std::vector<std::string>& words, const std::string& meaning) {
  std::vector<std::pair<std::string, std::string>> pairs;
  pairs.reserve(words.size());
  for (const std::string& word : words) pairs.emplace_back(word, word);
  return add_choice(app, name, value, std::move(pairs), meaning);
}

}  // namespace shearbus::program
