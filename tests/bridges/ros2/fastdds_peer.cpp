// A ROS 2 program as rmw_fastrtps sees one, without ROS: Fast DDS with the types' names and QoS of ROS 2 and no type
// information. Fields are (de)serialised by Fast CDR from the structs below; nothing is shared with edgemap.
//
//   fastdds_peer subscribe SECONDS TOPIC,TYPE,QOS,COUNT...   one JSON line for each message, until all counts are reached
//   fastdds_peer publish SECONDS TOPIC,TYPE,QOS,COUNT[,FILE]...   COUNT messages at 20 Hz once somebody listens, each
//       stamped 100 s + 50 ms * ticks since the start, and with contents made of the ticks
//
// QOS: reliable, best_effort or latched (reliable and transient local). ROS_DOMAIN_ID names the domain.
#include <unistd.h>
#include <fastcdr/Cdr.h>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdarg>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <memory>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

using namespace eprosima::fastdds::dds;
using eprosima::fastcdr::Cdr;
using eprosima::fastcdr::FastBuffer;

struct Out {
    Cdr& cdr;
    template <class T> void operator()(T& value) { cdr << value; }
    template <class T> void sequence(std::vector<T>& values) {
        cdr << static_cast<uint32_t>(values.size());
        for (auto& value : values) value.fields(*this);
    }
};
struct In {
    Cdr& cdr;
    template <class T> void operator()(T& value) { cdr >> value; }
    template <class T> void sequence(std::vector<T>& values) {
        uint32_t count;
        cdr >> count;
        values.resize(count);
        for (auto& value : values) value.fields(*this);
    }
};

#define FIELDS template <class A> void fields(A& a)
struct Header {
    int32_t sec = 0; uint32_t nanosec = 0; std::string frame;
    FIELDS { a(sec); a(nanosec); a(frame); }
};
Header stamped(int tick, const char* frame) {
    return {100 + tick / 20, uint32_t(tick % 20) * 50000000u, frame};
}
struct Xyz {
    double x = 0, y = 0, z = 0;
    FIELDS { a(x); a(y); a(z); }
};
struct Quaternion {
    double x = 0, y = 0, z = 0, w = 1;
    FIELDS { a(x); a(y); a(z); a(w); }
};
struct Pose {
    Xyz at; Quaternion q;
    FIELDS { at.fields(a); q.fields(a); }
};
struct PoseWithCovariance {
    Pose pose; std::array<double, 36> covariance{};
    FIELDS { pose.fields(a); a(covariance); }
};

std::string text(const char* format, ...) {
    char buffer[1024];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(buffer, sizeof buffer, format, arguments);
    va_end(arguments);
    return buffer;
}
std::string json(const Header& h) {
    return text("\"stamp_ns\": %lld, \"frame\": \"%s\"", h.sec * 1000000000LL + h.nanosec, h.frame.c_str());
}
std::string json(const Xyz& p) { return text("[%.17g, %.17g, %.17g]", p.x, p.y, p.z); }
std::string json(const Quaternion& q) { return text("[%.17g, %.17g, %.17g, %.17g]", q.x, q.y, q.z, q.w); }
template <size_t N> std::string json(const std::array<double, N>& values) {
    std::string found;
    for (double value : values) found += (found.empty() ? "[" : ", ") + text("%.17g", value);
    return found + "]";
}

struct TransformStamped {
    Header header; std::string child; Xyz at; Quaternion q;
    FIELDS { header.fields(a); a(child); at.fields(a); q.fields(a); }
};
struct TFMessage {
    static const char* name() { return "tf2_msgs::msg::dds_::TFMessage_"; }
    std::vector<TransformStamped> transforms;
    FIELDS { a.sequence(transforms); }
    void fill(int i, const std::string& as) {
        transforms.resize(3);
        if (!as.empty()) {  // a SLAM, which corrects itself once there is a file of this name
            transforms[2] = {stamped(i, "map"), "odom", {3, access(as.c_str(), F_OK) ? 0.0 : 0.5, 0}, {0, 0, 0, 1}};
            transforms[0] = {stamped(i, "odom"), "base_link", {0.05 * i, 0, 0.1}, {0, 0, 0, 1}};
            transforms[1] = {stamped(i, "base_link"), "base_footprint", {0, 0, -0.1}, {0, 0, 0, 1}};
            return;
        }
        transforms[0] = {stamped(i, "odom"), "base_link", {0.1 * i, 0.2, 0}, {0, 0, 0, 1}};
        transforms[1] = {stamped(i, "base_footprint"), "front_optical", {0.1, 0, 0.6}, {-0.5, 0.5, -0.5, 0.5}};
        transforms[2] = {stamped(i, "base_footprint"), "imu_link", {0, 0, 0.2}, {0, 0, 0, 1}};
    }
    std::string json_text() const {
        std::string found;
        for (auto& t : transforms)
            found += (found.empty() ? "" : ", ") + ("{" + json(t.header) + ", \"child\": \"" + t.child + "\", \"at\": " +
                     json(t.at) + ", \"q\": " + json(t.q) + "}");
        return "\"transforms\": [" + found + "]";
    }
};
struct Odometry {
    static const char* name() { return "nav_msgs::msg::dds_::Odometry_"; }
    Header header; std::string child; PoseWithCovariance pose;
    Xyz linear, angular; std::array<double, 36> twist_covariance{};
    FIELDS { header.fields(a); a(child); pose.fields(a); linear.fields(a); angular.fields(a); a(twist_covariance); }
    void fill(int i, const std::string&) {
        header = stamped(i, "odom");
        child = "base_link";
        pose.pose.at = {0.01 * i, -0.005 * i, 0};
        pose.pose.q = {0, 0, 0.0499791692706783, 0.998750260394966};  // 0.1 rad about z
    }
    std::string json_text() const {
        return json(header) + ", \"child\": \"" + child + "\", \"at\": " + json(pose.pose.at) + ", \"q\": " +
               json(pose.pose.q) + ", \"covariance\": " + json(pose.covariance) + ", \"linear\": " + json(linear) +
               ", \"angular\": " + json(angular);
    }
};
struct CompressedImage {
    static const char* name() { return "sensor_msgs::msg::dds_::CompressedImage_"; }
    Header header; std::string format; std::vector<uint8_t> data;
    FIELDS { header.fields(a); a(format); a(data); }
    void fill(int i, const std::string& file) {
        header = stamped(i, "front_optical");
        format = "rgb8; jpeg compressed bgr8";
        std::ifstream stream(file, std::ios::binary);
        data.assign(std::istreambuf_iterator<char>(stream), {});
    }
    std::string json_text() const {
        uint64_t hash = 1469598103934665603ULL;  // FNV-1a
        for (uint8_t byte : data) hash = (hash ^ byte) * 1099511628211ULL;
        return json(header) + ", \"format\": \"" + format + "\"" +
               text(", \"bytes\": %zu, \"fnv1a\": \"%016llx\"", data.size(), (unsigned long long)hash);
    }
};
struct Image {
    static const char* name() { return "sensor_msgs::msg::dds_::Image_"; }
    Header header; uint32_t height = 0, width = 0; std::string encoding; uint8_t big = 0; uint32_t step = 0;
    std::vector<uint8_t> data;
    FIELDS { header.fields(a); a(height); a(width); a(encoding); a(big); a(step); a(data); }
    template <class V> void depth(V first, V across, V down, V tick) {  // with padded rows
        step = 64 * sizeof(V) + 8;
        data.assign(height * step, 0);
        for (uint32_t y = 0; y < height; ++y)
            for (uint32_t x = 0; x < width; ++x)
                reinterpret_cast<V*>(&data[y * step])[x] = first + V(across * x) + V(down * y) + tick;
    }
    void fill(int i, const std::string& asked) {
        header = stamped(i, "front_optical");
        height = 48; width = 64;
        encoding = asked.empty() ? "rgb8" : asked;
        if (asked == "16UC1") return depth<uint16_t>(1000, 2, 5, uint16_t(i % 100));
        if (asked == "32FC1") return depth<float>(1.0f, 0.5f, -100.0f, 0.0f);
        step = 200;  // 192 and padding
        data.assign(height * step, 0);
        for (uint32_t y = 0; y < height; ++y)
            for (uint32_t x = 0; x < width; ++x) {
                uint8_t* pixel = &data[y * step + 3 * x];
                pixel[0] = uint8_t(x * 4), pixel[1] = uint8_t(y * 5), pixel[2] = uint8_t(i);
            }
    }
    std::string json_text() const { return json(header); }
};
struct CameraInfo {
    static const char* name() { return "sensor_msgs::msg::dds_::CameraInfo_"; }
    Header header; uint32_t height = 48, width = 64; std::string model = "plumb_bob"; std::vector<double> d{0, 0, 0, 0, 0};
    std::array<double, 9> k{58.25, 0, 31.5, 0, 58.5, 23.5, 0, 0, 1}, r{1, 0, 0, 0, 1, 0, 0, 0, 1};
    std::array<double, 12> p{58.25, 0, 31.5, 0, 0, 58.5, 23.5, 0, 0, 0, 1, 0};
    uint32_t bin_x = 0, bin_y = 0, roi_x = 0, roi_y = 0, roi_h = 0, roi_w = 0; bool rectify = false;
    FIELDS {
        header.fields(a); a(height); a(width); a(model); a(d); a(k); a(r); a(p);
        a(bin_x); a(bin_y); a(roi_x); a(roi_y); a(roi_h); a(roi_w); a(rectify);
    }
    void fill(int i, const std::string&) { header = stamped(i, "front_optical"); }
    std::string json_text() const { return json(header) + ", \"k\": " + json(k); }
};
struct Imu {
    static const char* name() { return "sensor_msgs::msg::dds_::Imu_"; }
    Header header; Quaternion q; std::array<double, 9> c0{}, c1{}, c2{}; Xyz gyro, accel;
    FIELDS { header.fields(a); q.fields(a); a(c0); gyro.fields(a); a(c1); accel.fields(a); a(c2); }
    void fill(int i, const std::string&) {
        header = stamped(i, "imu_link");
        gyro = {0.01, 0.02, 0.1 * i};
        accel = {0.1, 0.2, 9.81};
    }
    std::string json_text() const { return json(header) + ", \"gyro\": " + json(gyro); }
};
struct Detection3DArray {
    static const char* name() { return "vision_msgs::msg::dds_::Detection3DArray_"; }
    struct Hypothesis {
        std::string label; double score; PoseWithCovariance pose;
        FIELDS { a(label); a(score); pose.fields(a); }
    };
    struct Detection {
        Header header; std::vector<Hypothesis> results; Pose centre; Xyz size; std::string id;
        FIELDS { header.fields(a); a.sequence(results); centre.fields(a); size.fields(a); a(id); }
    };
    Header header; std::vector<Detection> detections;
    FIELDS { header.fields(a); a.sequence(detections); }
    void fill(int, const std::string&) {}
    std::string json_text() const {
        std::string found;
        for (auto& d : detections) {
            auto& best = d.results.at(0);
            found += (found.empty() ? "" : ", ") + ("{\"id\": \"" + d.id + "\", \"label\": \"" + best.label + "\", \"score\": " +
                     text("%.17g", best.score) + ", \"at\": " + json(best.pose.pose.at) + ", \"covariance\": " +
                     json(best.pose.covariance) + ", \"size\": " + json(d.size) + "}");
        }
        return json(header) + ", \"objects\": [" + found + "]";
    }
};

struct OccupancyGrid {
    static const char* name() { return "nav_msgs::msg::dds_::OccupancyGrid_"; }
    Header header; int32_t load_sec = 0; uint32_t load_nanosec = 0; float resolution = 0; uint32_t width = 0, height = 0;
    Pose origin; std::vector<int8_t> data;
    FIELDS { header.fields(a); a(load_sec); a(load_nanosec); a(resolution); a(width); a(height); origin.fields(a); a(data); }
    void fill(int, const std::string&) {}
    std::string json_text() const {
        std::string cells;  // occupied ones, as [column, row]
        for (size_t i = 0; i < data.size(); ++i)
            if (data[i] == 100) cells += (cells.empty() ? "" : ", ") + text("[%zu, %zu]", i % width, i / width);
        return json(header) + text(", \"resolution\": %.9g, \"width\": %u, \"height\": %u, \"free\": %zu, \"unknown\": %zu", resolution,
                                   width, height, size_t(std::count(data.begin(), data.end(), 0)),
                                   size_t(std::count(data.begin(), data.end(), -1))) +
               ", \"origin\": " + json(origin.at) + ", \"occupied\": [" + cells + "]";
    }
};

template <class T> class Type : public TopicDataType {
  public:
    Type() {
        setName(T::name());
        m_typeSize = 4 << 20;
        m_isGetKeyDefined = false;
        auto_fill_type_object(false);  // as rmw_fastrtps: readers and writers match by the types' names
        auto_fill_type_information(false);
    }
    bool serialize(void* data, eprosima::fastrtps::rtps::SerializedPayload_t* payload) override {
        FastBuffer buffer(reinterpret_cast<char*>(payload->data), payload->max_size);
        Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR);
        payload->encapsulation = CDR_LE;
        cdr.serialize_encapsulation();
        Out out{cdr};
        static_cast<T*>(data)->fields(out);
        payload->length = uint32_t(cdr.getSerializedDataLength());
        return true;
    }
    bool deserialize(eprosima::fastrtps::rtps::SerializedPayload_t* payload, void* data) override {
        FastBuffer buffer(reinterpret_cast<char*>(payload->data), payload->length);
        Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR);
        In in{cdr};
        try {
            cdr.read_encapsulation();
            static_cast<T*>(data)->fields(in);
        } catch (const eprosima::fastcdr::exception::Exception& error) {  // dropped, as rmw_fastrtps does
            fprintf(stderr, "%s of %u bytes: %s\n", T::name(), payload->length, error.what());
            return false;
        }
        return true;
    }
    std::function<uint32_t()> getSerializedSizeProvider(void*) override { return [] { return uint32_t(1 << 20); }; }
    void* createData() override { return new T; }
    void deleteData(void* data) override { delete static_cast<T*>(data); }
    bool getKey(void*, eprosima::fastrtps::rtps::InstanceHandle_t*, bool) override { return false; }
};

struct Spec { std::string topic, type, qos, file; int count; };

template <class Q> void reliability(Q& qos, const std::string& name) {
    qos.reliability().kind = name == "best_effort" ? BEST_EFFORT_RELIABILITY_QOS : RELIABLE_RELIABILITY_QOS;
    qos.durability().kind = name == "latched" ? TRANSIENT_LOCAL_DURABILITY_QOS : VOLATILE_DURABILITY_QOS;
    qos.history().kind = KEEP_LAST_HISTORY_QOS;
    qos.history().depth = 50;
    qos.endpoint().history_memory_policy = eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
}

struct Port {  // one topic, in one direction
    Spec spec;
    int done = 0;
    virtual ~Port() = default;
    virtual void poll(int tick) = 0;
    virtual bool finished() { return done >= spec.count; }
};
template <class T> struct Reading : Port {
    DataReader* reader;
    Reading(DomainParticipant* participant, Subscriber* subscriber, const Spec& s) {
        spec = s;
        TypeSupport(new Type<T>).register_type(participant);
        auto* topic = participant->create_topic(s.topic, T::name(), TOPIC_QOS_DEFAULT);
        DataReaderQos qos;
        reliability(qos, s.qos);
        reader = subscriber->create_datareader(topic, qos);
    }
    void poll(int) override {
        T message;
        SampleInfo info;
        while (reader->take_next_sample(&message, &info) == ReturnCode_t::RETCODE_OK)
            if (info.valid_data && done++ < spec.count) {
                auto now = std::chrono::system_clock::now().time_since_epoch();
                auto ns = std::chrono::duration_cast<std::chrono::nanoseconds>(now).count();
                printf("{\"topic\": \"%s\", \"received_ns\": %lld, %s}\n", spec.topic.c_str(), (long long)ns,
                       message.json_text().c_str());
                fflush(stdout);
            }
    }
};
template <class T> struct Writing : Port {
    DataWriter* writer;
    Writing(DomainParticipant* participant, Publisher* publisher, const Spec& s) {
        spec = s;
        TypeSupport(new Type<T>).register_type(participant);
        auto* topic = participant->create_topic(s.topic, T::name(), TOPIC_QOS_DEFAULT);
        DataWriterQos qos;
        reliability(qos, s.qos);
        qos.publish_mode().kind = ASYNCHRONOUS_PUBLISH_MODE;  // large ones go in fragments
        writer = publisher->create_datawriter(topic, qos);
    }
    void poll(int tick) override {
        PublicationMatchedStatus status;
        writer->get_publication_matched_status(status);
        if ((status.current_count == 0 && spec.qos != "latched") || finished()) return;
        T message;
        message.fill(tick, spec.file);
        ++done;
        writer->write(&message);
    }
};

template <template <class> class P, class E> std::unique_ptr<Port> open(DomainParticipant* participant, E* end, const Spec& s) {
    if (s.type == "TFMessage") return std::make_unique<P<TFMessage>>(participant, end, s);
    if (s.type == "Odometry") return std::make_unique<P<Odometry>>(participant, end, s);
    if (s.type == "CompressedImage") return std::make_unique<P<CompressedImage>>(participant, end, s);
    if (s.type == "Image") return std::make_unique<P<Image>>(participant, end, s);
    if (s.type == "CameraInfo") return std::make_unique<P<CameraInfo>>(participant, end, s);
    if (s.type == "Imu") return std::make_unique<P<Imu>>(participant, end, s);
    if (s.type == "Detection3DArray") return std::make_unique<P<Detection3DArray>>(participant, end, s);
    if (s.type == "OccupancyGrid") return std::make_unique<P<OccupancyGrid>>(participant, end, s);
    fprintf(stderr, "unknown type %s\n", s.type.c_str());
    exit(2);
}

int main(int count, char** arguments) {
    bool publishes = std::string(arguments[1]) == "publish";
    auto until = std::chrono::steady_clock::now() + std::chrono::duration<double>(atof(arguments[2]));
    const char* domain = getenv("ROS_DOMAIN_ID");
    auto* participant = DomainParticipantFactory::get_instance()->create_participant(
        domain ? atoi(domain) : 0, PARTICIPANT_QOS_DEFAULT);
    if (!participant) return 2;
    std::vector<std::unique_ptr<Port>> ports;
    auto* publisher = participant->create_publisher(PUBLISHER_QOS_DEFAULT);
    auto* subscriber = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
    for (int i = 3; i < count; ++i) {
        std::istringstream parts(arguments[i]);
        Spec s;
        std::string number;
        std::getline(parts, s.topic, ','), std::getline(parts, s.type, ','), std::getline(parts, s.qos, ',');
        std::getline(parts, number, ','), std::getline(parts, s.file, ',');
        s.count = atoi(number.c_str());
        ports.push_back(publishes ? open<Writing>(participant, publisher, s) : open<Reading>(participant, subscriber, s));
    }
    bool finished = false;
    int tick = 0;
    while (!finished && std::chrono::steady_clock::now() < until) {
        finished = true;
        for (auto& port : ports) {
            port->poll(tick);
            finished = finished && port->finished();
        }
        std::this_thread::sleep_for(std::chrono::milliseconds(publishes ? 50 : 1));
        ++tick;
    }
    if (publishes) std::this_thread::sleep_until(until);  // late joiners
    std::_Exit(finished ? 0 : 1);  // without the orderly end, which takes Fast DDS a second
}
