// A folder with an engine and fake stages of its own, in which tests run the command line and count
// which stages were started.
#pragma once

#include <sys/types.h>

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "pipeline/base/atomic_file.hpp"

namespace viscera::test {

struct CommandResult {
  int exit = 0;        // 128 + signal when killed
  std::string out;     // stdout
  std::string errors;  // stderr
};

bool contains(const std::string& text, const std::string& part);
int count(const std::string& text, const std::string& part);  // how often it occurs

class Workplace {
 public:
  // With spec.yaml over alpha, beta and gamma, and volume.txt.
  Workplace();

  std::filesystem::path path(const std::string& name) const { return folder_.path() / name; }
  void write(const std::string& name, const std::string& text) const;
  std::string read(const std::string& name) const { return read_file(path(name)); }

  // `viscera` with these arguments in this folder; `environment` holds NAME=VALUE texts.
  CommandResult viscera(const std::vector<std::string>& arguments,
                        const std::vector<std::string>& environment = {}) const;
  // `viscera run SPEC`, and of spec.yaml.
  CommandResult run_spec(const std::string& spec, std::vector<std::string> extra = {},
                         const std::vector<std::string>& environment = {}) const;
  CommandResult run(const std::vector<std::string>& extra = {},
                    const std::vector<std::string>& environment = {}) const;

  // The same in the background.
  pid_t start(const std::vector<std::string>& arguments,
              const std::vector<std::string>& environment = {}) const;
  pid_t start_program(const std::string& program, const std::vector<std::string>& arguments,
                      const std::vector<std::string>& environment = {}) const;
  CommandResult finish(pid_t process) const;

  // Stages that were started ("alpha run\nbeta run\n") since the last call.
  std::string started() const;
  void wait_until_started(const std::string& line) const;  // a line of the same, not consumed

  // Every file below the folder with its content, inode and time of change.
  std::map<std::string, std::string> snapshot() const;

 private:
  TemporaryFolder folder_;
};

}  // namespace viscera::test
