// One end of a connection on the real YARP, for the comparison in yarp/examples/wire.rs, which has the same roles.

#include <yarp/os/all.h>
#include <yarp/sig/Image.h>
#include <yarp/sig/Vector.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <mutex>
#include <string>
#include <vector>

using yarp::os::Bottle;
using yarp::os::Network;
using yarp::sig::Vector;
using RgbImage = yarp::sig::ImageOf<yarp::sig::PixelRgb>;

namespace {

double now()
{
    return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

int say(std::vector<double>& seconds, size_t sent)
{
    std::sort(seconds.begin(), seconds.end());
    auto at = [&](double part) {
        return seconds.empty() ? 0.0 : 1e6 * seconds[std::min(seconds.size() - 1, size_t(part * seconds.size()))];
    };
    std::printf("result %.1f %.1f %.1f %zu %zu\n", at(0.5), at(0.99), at(1.0), seconds.size(), sent);
    return 0;
}

class Answers : public yarp::os::PortReader
{
    bool read(yarp::os::ConnectionReader& in) override
    {
        Bottle request, reply;
        if (!request.read(in)) {
            return false;
        }
        reply.addVocab32("is");
        reply.addVocab32("encs");
        Bottle& values = reply.addList();
        for (int i = 0; i < 16; i++) {
            values.addFloat64(0.1 * i);
        }
        reply.addVocab32("ok");
        if (auto* out = in.getWriter()) {
            reply.write(*out);
        }
        return true;
    }
};

int serve(const std::string& name)
{
    Answers answers;
    yarp::os::RpcServer port;
    port.setReader(answers);
    if (!port.open(name)) {
        return 1;
    }
    std::puts("ready");
    std::fflush(stdout);
    std::getchar();
    port.close();
    return 0;
}

int call(const std::string& name, const std::string& server, size_t count, const std::string& carrier)
{
    yarp::os::RpcClient port;
    if (!port.open(name) || !port.addOutput(server, carrier.c_str())) {
        return 1;
    }
    std::vector<double> seconds;
    Bottle request("[get] [encs]"), reply;
    for (size_t i = 0; i < count + 100; i++) {
        double start = now();
        if (!port.write(request, reply) || reply.size() != 4) {
            return 1;
        }
        if (i >= 100) {
            seconds.push_back(now() - start);
        }
    }
    port.close();
    return say(seconds, count);
}

// Every message carries when it was made and its number.
void put(Vector& message, double at, double number)
{
    message.resize(16);
    message[0] = at;
    message[1] = number;
}

void put(RgbImage& message, double at, double number)
{
    message.resize(320, 240);
    double both[2] = {at, number};
    std::memcpy(message.getRawImage(), both, sizeof both);
}

double made(const Vector& message)
{
    return message[0];
}

double made(const RgbImage& message)
{
    double at;
    std::memcpy(&at, message.getRawImage(), sizeof at);
    return at;
}

template <class T>
int publish(const std::string& name, size_t count, double period)
{
    yarp::os::BufferedPort<T> port;
    if (!port.open(name)) {
        return 1;
    }
    std::puts("ready");
    std::fflush(stdout);
    while (port.getOutputCount() == 0) {
        yarp::os::Time::delay(0.01);
    }
    yarp::os::Time::delay(0.2);
    double next = now();
    for (size_t i = 0; i < count; i++) {
        put(port.prepare(), now(), double(i));
        port.write();
        next += period;
        yarp::os::Time::delay(std::max(0.0, next - now()));
    }
    std::getchar();
    port.close();
    return 0;
}

template <class T>
class Watch : public yarp::os::TypedReaderCallback<T>
{
public:
    std::mutex lock;
    std::vector<double> seconds;
    double last = now();

    using yarp::os::TypedReaderCallback<T>::onRead;
    void onRead(T& message) override
    {
        double at = now();
        std::lock_guard<std::mutex> guard(lock);
        last = at;
        seconds.push_back(at - made(message));
    }
};

template <class T>
int watch(const std::string& name, const std::string& source, size_t count, const std::string& carrier)
{
    Watch<T> watch;
    yarp::os::BufferedPort<T> port;
    port.setStrict(true);
    port.useCallback(watch);
    if (!port.open(name) || !Network::connect(source, name, carrier)) {
        return 1;
    }
    for (bool waits = true; waits;) {
        yarp::os::Time::delay(0.1);
        std::lock_guard<std::mutex> guard(watch.lock);
        waits = watch.seconds.size() < count && now() - watch.last < 2;
    }
    port.close();
    return say(watch.seconds, count);
}

} // namespace

int main(int argc, char** argv)
{
    std::vector<std::string> args(argv + 1, argv + argc);
    args.resize(6);
    Network network;
    network.setVerbosity(-1);
    size_t number = args[4].empty() ? 0 : std::stoul(args[4]);
    bool image = args[1] == "image";
    if (args[0] == "serve") {
        return serve(args[2]);
    }
    if (args[0] == "call") {
        return call(args[2], args[3], number, args[5]);
    }
    if (args[0] == "publish") {
        double period = std::stod(args[3]);
        return image ? publish<RgbImage>(args[2], number, period) : publish<Vector>(args[2], number, period);
    }
    if (args[0] == "watch") {
        return image ? watch<RgbImage>(args[2], args[3], number, args[5])
                     : watch<Vector>(args[2], args[3], number, args[5]);
    }
    std::fputs("usage: wire serve|call|publish|watch KIND NAME PEER|PERIOD COUNT CARRIER\n", stderr);
    return 2;
}
