// What the command lines of all programs share: the form of the help, --version with --json, options whose value is one
// of a few words, and errors that name the nearest known word.
#pragma once

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace shearbus::program {

// Prepares a program's command line: its name, which stands in its usage and before its errors, the form of its help,
// and --version. `version_text` returns the answer to --version, as text or as one line of JSON; JSON is chosen by the
// flag --json, which is added here unless the program has a --json of its own. `footer` ends the help: examples and exit
// codes. Call complete() after the options of the program have been added.
using VersionText = std::string (*)(const std::string& program, bool json);
void complete(CLI::App& app, const std::string& program, VersionText version_text, const std::string& footer);

// Parses the command line, then calls `check`, which may throw CLI::ParseError. Returns the exit code if the program
// ends here: 0 after --help and --version, 2 for a wrong command line, which it reports on standard error.
std::optional<int> parse(CLI::App& app, int argc, const char* const* argv, const std::function<void()>& check = {});

// Hold the values of an option to one rule: digits for a whole number, a finite decimal number for a real one
// (numbers.hpp), whatever the option library takes for numbers. parse() does so for all options whose type in the help
// is a number's; an option with a type name of its own is passed through one of these when it is added.
CLI::Option* whole_number(CLI::Option* option);
CLI::Option* real_number(CLI::Option* option);

// Returns what a wrong word gets: "NAME: expected a, b or c, found WORD; did you mean b?".
std::string wrong_word(const std::string& name, const std::string& word, const std::vector<std::string>& known);

// Adds an option whose value is one of `words`, each with the value that it stands for.
template <typename T>
CLI::Option* add_choice(CLI::App& app, const std::string& name, T& value, std::vector<std::pair<std::string, T>> words,
                        const std::string& meaning) {
  std::vector<std::string> known;
  std::string type;
  for (const auto& [word, meant] : words) {
    known.push_back(word);
    type += (type.empty() ? "" : "|") + word;
  }
  return app
      .add_option_function<std::string>(
          name,
          [&value, name, known, words = std::move(words)](const std::string& found) {
            for (const auto& [word, meant] : words)
              if (word == found) {
                value = meant;
                return;
              }
            throw CLI::ValidationError(wrong_word(name, found, known), CLI::ExitCodes::ValidationError);
          },
          meaning)
      ->type_name(type);
}

// Likewise for an option whose value is the word itself.
CLI::Option* add_choice(CLI::App& app, const std::string& name, std::string& value,
                        const std::vector<std::string>& words, const std::string& meaning);

}  // namespace shearbus::program
