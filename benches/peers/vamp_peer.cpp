// VAMP as a peer of `cargo bench -p mobee-fast --bench peers`: see README.md beside this file.
//
// usage: vamp_peer ROBOT FOLDER
//   FOLDER/edges.f32    per edge: start, then goal
//   FOLDER/spheres.f32  per obstacle: x, y, z, radius
// Writes FOLDER/verdicts (a byte per edge: 1 is free) and prints "ready". Then replies to every line of its input with the
// number of configurations checked per second of processor time, over the edges whose byte in FOLDER/asked is 1.
#include <cmath>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <iostream>
#include <string>
#include <vector>

#include <vamp/collision/factory.hh>
#include <vamp/planning/validate.hh>
#include <vamp/robots/baxter.hh>
#include <vamp/robots/panda.hh>
#include <vamp/robots/ur5.hh>
#include <vamp/vector.hh>

constexpr std::size_t rake = vamp::FloatVectorWidth;
using Environment = vamp::collision::Environment<vamp::FloatVector<rake>>;

template <typename T>
static std::vector<T> read(const std::string &path)
{
    std::ifstream file(path, std::ios::binary | std::ios::ate);
    const auto bytes = static_cast<std::size_t>(std::max<std::streamoff>(file.tellg(), 0));
    std::vector<T> all(bytes / sizeof(T));
    file.seekg(0);
    file.read(reinterpret_cast<char *>(all.data()), static_cast<std::streamsize>(all.size() * sizeof(T)));
    return all;
}

static double processor_time()
{
    timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

template <typename Robot>
static int serve(const std::string &folder)
{
    vamp::collision::Environment<float> scalar;
    const auto obstacles = read<float>(folder + "/spheres.f32");
    for (std::size_t i = 0; i + 3 < obstacles.size(); i += 4)
        scalar.spheres.emplace_back(obstacles[i], obstacles[i + 1], obstacles[i + 2], obstacles[i + 3]);
    scalar.sort();
    const Environment environment(scalar);

    const auto numbers = read<float>(folder + "/edges.f32");
    constexpr std::size_t n = Robot::dimension;
    using Configuration = typename Robot::Configuration;
    std::vector<Configuration> ends;
    for (std::size_t i = 0; i + n <= numbers.size(); i += n)
    {
        typename Robot::ConfigurationBuffer buffer{};
        std::copy_n(numbers.begin() + static_cast<std::ptrdiff_t>(i), n, buffer.begin());
        ends.emplace_back(buffer.data());
    }
    const auto free = [&](std::size_t edge)
    {
        return vamp::planning::validate_motion<Robot, rake, Robot::resolution>(
            ends[2 * edge], ends[2 * edge + 1], environment);
    };
    const auto edges = ends.size() / 2;
    {
        std::ofstream verdicts(folder + "/verdicts", std::ios::binary);
        for (std::size_t edge = 0; edge < edges; ++edge)
            verdicts.put(free(edge) ? 1 : 0);
    }
    std::cout << "ready " << rake << " " << Robot::resolution << std::endl;

    for (std::string line; std::getline(std::cin, line);)
    {
        const auto asked = read<char>(folder + "/asked");
        double configurations = 0, spent = 0, held = 0;
        const double begin = processor_time();
        do
        {
            for (std::size_t edge = 0; edge < edges && edge < asked.size(); ++edge)
                if (asked[edge])
                {
                    held += free(edge);
                    const float length = (ends[2 * edge + 1] - ends[2 * edge]).l2_norm();
                    configurations += rake * std::max(std::ceil(length / rake * Robot::resolution), 1.F);
                }
            spent = processor_time() - begin;
        } while (spent < 0.1 && configurations > 0);
        std::cout << configurations / spent << " " << held << std::endl;
    }
    return 0;
}

int main(int count, char **words)
{
    const std::string robot = count > 2 ? words[1] : "", folder = count > 2 ? words[2] : "";
    if (robot == "panda")
        return serve<vamp::robots::Panda>(folder);
    if (robot == "baxter")
        return serve<vamp::robots::Baxter>(folder);
    if (robot == "ur5")
        return serve<vamp::robots::UR5>(folder);
    std::cerr << "usage: vamp_peer panda|baxter|ur5 FOLDER" << std::endl;
    return 2;
}
