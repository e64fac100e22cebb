//! Every kind of actuator that has motors is reached by messages.

use whorl_dynamics::actuators::{ActuatorKind, Actuators};
use whorl_msgs::topics::{MessageType, Topic};
use whorl_msgs::whorl::ActuatorCommand;

#[test]
fn every_kind_with_motors_has_its_field_and_topic() {
    let mut fields = Vec::new();
    for channel in Actuators::default().kinds().into_iter().filter_map(ActuatorKind::channel) {
        let mut command = ActuatorCommand::default();
        let field = channel.command_field;
        let slot = command.motor_commands_mut(field);
        slot.unwrap_or_else(|| panic!("the actuator command has no motor commands {field}")).push(1.5);
        assert_eq!(command.motor_commands(field), Some(&[1.5][..]));
        assert!(!fields.contains(&field), "{field} serves two kinds");
        fields.push(field);
        let topic = Topic::find(channel.state_topic, true);
        let topic = topic.unwrap_or_else(|| panic!("there is no topic {}", channel.state_topic));
        assert_eq!(topic.info().message_type, MessageType::JointState);
        assert!(Topic::FROM_DRIVER.contains(&topic), "the driver does not send {}", channel.state_topic);
    }
    assert!(!fields.is_empty());
}
