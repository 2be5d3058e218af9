// An ordinary YARP program, as people have written them for years: it knows nothing of MoBeE.
//
// It opens a robot's part by `remote_controlboard`, moves it to one pose after the other, and polls for the end of each
// motion. Whatever fails, it says so and tries the call again until it works.
//
//   reach --remote /MoBeE/icub/right_arm --local /reach [--carrier tcp] [--speed 20] [--facts yes] --pose "(j0 j1 ...)" --pose ...
//
// With --facts it first prints a line for each joint: `joint J TYPE MIN MAX`, and after each motion `at K (q0 q1 ...)`.
// Prints one line per event: `axes N`, `moving K`, `reached K`, `failed K`, `again K MILLISECONDS`, `bye`.

#include <yarp/dev/ControlBoardInterfaces.h>
#include <yarp/dev/PolyDriver.h>
#include <yarp/os/Bottle.h>
#include <yarp/os/Network.h>
#include <yarp/os/Property.h>
#include <yarp/os/SystemClock.h>

#include <cmath>
#include <cstdio>
#include <cstring>
#include <string>
#include <vector>

namespace {

const double patience = 60.0; // seconds for any one thing

double now() { return yarp::os::SystemClock::nowSystem(); }

void rest(double seconds) { yarp::os::SystemClock::delaySystem(seconds); }

int give_up(const char* what)
{
    std::printf("gave up: %s\n", what);
    return 1;
}

} // namespace

int main(int argc, char* argv[])
{
    setvbuf(stdout, nullptr, _IOLBF, 0);
    std::string remote, local = "/reach", carrier = "tcp";
    double speed = 20.0;
    int rounds = 1;
    bool facts = false;
    std::vector<yarp::os::Bottle> poses;
    for (int i = 1; i + 1 < argc; i += 2) {
        const std::string key = argv[i], value = argv[i + 1];
        if (key == "--remote") {
            remote = value;
        } else if (key == "--local") {
            local = value;
        } else if (key == "--carrier") {
            carrier = value;
        } else if (key == "--speed") {
            speed = std::atof(value.c_str());
        } else if (key == "--facts") {
            facts = true;
        } else if (key == "--rounds") {
            rounds = std::atoi(value.c_str());
        } else if (key == "--pose") {
            poses.emplace_back(value);
        }
    }

    yarp::os::Network network;
    if (!yarp::os::Network::checkNetwork(5.0)) {
        return give_up("there is no name server");
    }
    yarp::os::Property options;
    options.put("device", "remote_controlboard");
    options.put("remote", remote);
    options.put("local", local);
    options.put("carrier", carrier);
    yarp::dev::PolyDriver driver(options);
    yarp::dev::IPositionControl* position = nullptr;
    yarp::dev::IEncoders* encoders = nullptr;
    yarp::dev::IControlMode* modes = nullptr;
    yarp::dev::IControlLimits* limits = nullptr;
    if (!driver.isValid() || !driver.view(position) || !driver.view(encoders) || !driver.view(modes)
        || !driver.view(limits)) {
        return give_up("the device does not open");
    }
    int axes = 0;
    position->getAxes(&axes);
    std::printf("axes %d\n", axes);
    yarp::dev::IAxisInfo* info = nullptr;
    for (int j = 0; facts && j < axes; ++j) {
        yarp::dev::JointTypeEnum type = yarp::dev::VOCAB_JOINTTYPE_UNKNOWN;
        double min = 0.0, max = 0.0;
        if (!driver.view(info) || !info->getJointType(j, type) || !limits->getLimits(j, &min, &max)) {
            return give_up("the joints are not told");
        }
        const char* word = type == yarp::dev::VOCAB_JOINTTYPE_PRISMATIC ? "prismatic"
            : type == yarp::dev::VOCAB_JOINTTYPE_REVOLUTE               ? "revolute"
                                                                        : "unknown";
        std::printf("joint %d %s %.3f %.3f\n", j, word, min, max);
    }

    int k = 0;
    for (int round = 0; round < rounds; ++round) {
        for (const auto& line : poses) {
            const yarp::os::Bottle* list = line.size() == 1 ? line.get(0).asList() : &line;
            const int n = static_cast<int>(list->size());
            std::vector<int> joints(n), position_mode(n, VOCAB_CM_POSITION);
            std::vector<double> target(n), speeds(n, speed);
            for (int j = 0; j < n; ++j) {
                joints[j] = j;
                target[j] = list->get(j).asFloat64();
            }
            const double begun = now();
            while (!modes->setControlModes(n, joints.data(), position_mode.data())
                   || !position->setRefSpeeds(n, joints.data(), speeds.data())
                   || !position->positionMove(n, joints.data(), target.data())) {
                if (now() - begun > patience) {
                    return give_up("no motion is taken");
                }
                rest(0.01);
            }
            std::printf("moving %d\n", k);

            bool done = false, failed = false;
            double failed_at = 0.0;
            const double moving = now();
            while (!done) {
                if (!position->checkMotionDone(&done)) {
                    if (!failed) {
                        failed = true;
                        failed_at = now();
                        std::printf("failed %d\n", k);
                    }
                    done = false;
                } else if (failed) {
                    // served again: the motion that failed is over
                    std::printf("again %d %.0f\n", k, 1e3 * (now() - failed_at));
                    break;
                }
                if (now() - moving > patience) {
                    return give_up("the motion does not end");
                }
                rest(0.005);
            }
            if (!failed) {
                std::vector<double> q(axes);
                encoders->getEncoders(q.data());
                double away = 0.0;
                for (int j = 0; j < n; ++j) {
                    away = std::fmax(away, std::fabs(q[j] - target[j]));
                }
                std::printf("reached %d %.3f\n", k, away);
                if (facts) {
                    std::printf("at %d", k);
                    for (int j = 0; j < n; ++j) {
                        std::printf(" %.4f", q[j]);
                    }
                    std::printf("\n");
                }
            }
            ++k;
        }
    }
    driver.close();
    std::printf("bye\n");
    return 0;
}
