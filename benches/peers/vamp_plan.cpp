// VAMP as a peer of `mobee bench plan`: see README.md beside this file. Started by plan_peer.py.
//
// usage: vamp_plan panda|ur5|fetch rrt_connect|aorrtc ROUNDS ITERATIONS < problems
//   a problem: start, goal, number of boxes, each with center, Euler angles (sxyz) and half extents, number of capsules, each
//   with center, Euler angles, radius and length
// Prints a line per problem: valid, solved, ms of scene, plan and simplification (each the least of ROUNDS), iterations, cost,
// simplified cost.
#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <ctime>
#include <iostream>
#include <memory>
#include <string>

#include <vamp/collision/factory.hh>
#include <vamp/planning/aorrtc.hh>
#include <vamp/planning/rrtc.hh>
#include <vamp/planning/simplify.hh>
#include <vamp/planning/validate.hh>
#include <vamp/random/halton.hh>
#include <vamp/robots/fetch.hh>
#include <vamp/robots/panda.hh>
#include <vamp/robots/ur5.hh>
#include <vamp/vector.hh>

constexpr std::size_t rake = vamp::FloatVectorWidth;
using Scalar = vamp::collision::Environment<float>;
using Environment = vamp::collision::Environment<vamp::FloatVector<rake>>;
namespace factory = vamp::collision::factory;

static double processor_ms()
{
    timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
}

template <std::size_t n>
static bool numbers(std::array<float, n> &all)
{
    for (float &x : all)
        std::cin >> x;
    return static_cast<bool>(std::cin);
}

// The obstacles of a problem.
struct Obstacles
{
    std::vector<std::array<float, 9>> boxes;
    std::vector<std::array<float, 8>> capsules;

    template <std::size_t n>
    static void read(std::vector<std::array<float, n>> &all)
    {
        std::size_t count = 0;
        std::cin >> count;
        all.resize(std::cin ? count : 0);
        for (auto &row : all)
            numbers(row);
    }

    // As VAMP's bindings build it.
    [[nodiscard]] Environment environment() const
    {
        Scalar scene;
        for (const auto &[x, y, z, i, j, k, a, b, c] : boxes)
        {
            const auto box = factory::cuboid::flat(x, y, z, i, j, k, a, b, c);
            (box.axis_3_z == 1.F ? scene.z_aligned_cuboids : scene.cuboids).emplace_back(box);
        }
        for (const auto &[x, y, z, i, j, k, radius, length] : capsules)
        {
            const auto capsule = factory::cylinder::center::flat(x, y, z, i, j, k, radius, length);
            (capsule.xv == 0.F and capsule.yv == 0.F ? scene.z_aligned_capsules : scene.capsules).emplace_back(capsule);
        }
        scene.sort();
        return Environment(scene);
    }
};

template <typename Robot>
static int run(float range, bool is_anytime, int rounds, std::size_t iterations)
{
    using Configuration = typename Robot::Configuration;
    namespace planning = vamp::planning;
    auto rng = std::make_shared<vamp::rng::Halton<Robot>>();
    planning::RRTCSettings settings;
    settings.range = range;
    settings.max_iterations = settings.max_samples = 1000000;
    planning::AORRTCSettings anytime;
    anytime.rrtc.range = range;
    anytime.max_iterations = anytime.max_internal_iterations = iterations;
    anytime.max_samples = 100000;

    std::array<float, Robot::dimension> ends[2];
    while (numbers(ends[0]) && numbers(ends[1]))
    {
        Obstacles obstacles;
        Obstacles::read(obstacles.boxes);
        Obstacles::read(obstacles.capsules);
        typename Robot::ConfigurationBuffer buffer[2]{};
        for (int i = 0; i < 2; ++i)
            std::copy(ends[i].begin(), ends[i].end(), buffer[i].begin());
        const Configuration start(buffer[0].data()), goal(buffer[1].data());
        double scene_ms = 1e9, plan_ms = 1e9, simplify_ms = 1e9;
        planning::PlanningResult<Robot> found, shorter;
        bool is_valid = false;
        for (int round = 0; round < rounds; ++round)
        {
            const double begin = processor_ms();
            const Environment environment = obstacles.environment();
            scene_ms = std::min(scene_ms, processor_ms() - begin);
            is_valid = planning::validate_motion<Robot, rake, 1>(start, start, environment) &&
                       planning::validate_motion<Robot, rake, 1>(goal, goal, environment);
            if (not is_valid)
                break;
            rng->reset();
            if (is_anytime)
            {
                found = planning::AORRTC<Robot, rake, Robot::resolution>::solve(start, goal, environment, anytime, rng);
                shorter = found;
                simplify_ms = 0;
                plan_ms = std::min(plan_ms, 1e-6 * static_cast<double>(found.nanoseconds));
                continue;
            }
            const double before = processor_ms();
            found = planning::RRTC<Robot, rake, Robot::resolution>::solve(start, goal, environment, settings, rng);
            // Its own clock leaves out the allocation of a million samples, processor time leaves out other processes.
            plan_ms = std::min({plan_ms, processor_ms() - before, 1e-6 * static_cast<double>(found.nanoseconds)});
            if (found.path.empty())
                continue;
            const double planned = processor_ms();
            shorter = planning::simplify<Robot, rake, Robot::resolution>(
                found.path, environment, planning::SimplifySettings(), rng);
            simplify_ms = std::min(
                {simplify_ms, processor_ms() - planned, 1e-6 * static_cast<double>(shorter.nanoseconds)});
        }
        const bool is_solved = not found.path.empty();
        std::cout << is_valid << ' ' << is_solved << ' ' << scene_ms << ' ' << plan_ms << ' ' << simplify_ms << ' '
                  << found.iterations << ' ' << (is_solved ? found.path.cost() : 0) << ' '
                  << (is_solved ? shorter.path.cost() : 0) << std::endl;
    }
    return 0;
}

int main(int count, char **words)
{
    const std::string robot = count == 5 ? words[1] : "", planner = count == 5 ? words[2] : "";
    const int rounds = count == 5 ? std::max(std::atoi(words[3]), 1) : 1;
    const std::size_t iterations = count == 5 ? std::strtoul(words[4], nullptr, 10) : 0;
    const bool is_anytime = planner == "aorrtc";
    if (robot == "panda")
        return run<vamp::robots::Panda>(1.F, is_anytime, rounds, iterations);
    if (robot == "ur5")
        return run<vamp::robots::UR5>(1.5F, is_anytime, rounds, iterations);
    if (robot == "fetch")
        return run<vamp::robots::Fetch>(1.F, is_anytime, rounds, iterations);
    std::cerr << "usage: vamp_plan panda|ur5|fetch rrt_connect|aorrtc ROUNDS ITERATIONS < problems" << std::endl;
    return 2;
}
