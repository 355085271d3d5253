#ifndef OPENMMRIGIDHI_STRICT_NODE_H_
#define OPENMMRIGIDHI_STRICT_NODE_H_

#include <openmm/OpenMMException.h>
#include <openmm/serialization/SerializationNode.h>

#include <charconv>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace RigidHIPlugin {

/**
 * Reads properties of a SerializationNode and refuses anything that is not wholly a number.
 * OpenMM's own getters turn "abc" into 0 and "1x" into 1.
 */
class StrictNode {
public:
    StrictNode(const OpenMM::SerializationNode& node, std::string className)
        : node(node), className(std::move(className)) {}

    /** A copy, because OpenMM returns a reference before version 8.6 and a copy from then on. */
    std::string text(const std::string& property) const {
        if (!node.hasProperty(property))
            fail("property '" + property + "' is missing", "every property must be present");
        return node.getStringProperty(property);
    }
    double number(const std::string& property) const { return parse<double>(property, "a number"); }
    /** @tparam T  int by default; a longer or an unsigned type has its own range */
    template <class T = int>
    T integer(const std::string& property) const {
        return parse<T>(property,
                        std::is_unsigned<T>::value ? "an integer from 0 up" : "an integer");
    }
    bool boolean(const std::string& property) const {
        const int value = integer(property);
        if (value != 0 && value != 1) wrongValue(property, "0 or 1");
        return value == 1;
    }
    StrictNode child(const std::string& name) const {
        for (const OpenMM::SerializationNode& child : node.getChildren())
            if (child.getName() == name) return StrictNode(child, className);
        fail("the element '" + name + "' is missing", "this element must be present");
    }
    /**
     * Check that this node has as many children as one of its properties says. A truncated file has
     * fewer.
     */
    void checkChildren(const std::string& countProperty) const {
        const int expected = integer(countProperty);
        const int found = node.getChildren().size();
        if (found != expected)
            fail("it has " + std::to_string(found) + " elements",
                 "it must have " + std::to_string(expected) + ", as its property '" +
                     countProperty + "' says");
    }
    const std::string& name() const { return node.getName(); }
    bool has(const std::string& property) const { return node.hasProperty(property); }
    const std::vector<OpenMM::SerializationNode>& children() const { return node.getChildren(); }

    [[noreturn]] void wrongValue(const std::string& property, const std::string& expected) const {
        fail("property '" + property + "' is '" + node.getStringProperty(property) + "'",
             "it must be " + expected);
    }
    [[noreturn]] void fail(const std::string& problem, const std::string& bound) const {
        throw OpenMM::OpenMMException(
            className + ": XML element '" + node.getName() + "': " + problem + "; " + bound +
            ": the file is damaged or foreign, write it anew with XmlSerializer");
    }

private:
    template <class T>
    T parse(const std::string& property, const std::string& expected) const {
        const std::string value = text(property);
        T result{};
        // from_chars is independent of the locale, unlike streams and strtod.
        const auto parsed = std::from_chars(value.data(), value.data() + value.size(), result);
        if (parsed.ec != std::errc() || parsed.ptr != value.data() + value.size())
            wrongValue(property, expected);
        return result;
    }
    const OpenMM::SerializationNode& node;
    std::string className;
};

}  // namespace RigidHIPlugin

#endif
