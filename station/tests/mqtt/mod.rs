//! The station at a real broker, mosquitto.

mod home;
mod mosquitto;
mod publish;
mod reconnect;
mod secrets;
mod station;
