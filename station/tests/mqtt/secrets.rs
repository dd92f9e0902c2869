//! Users, passwords and certificates.

use rcgen::{BasicConstraints, CertificateParams, CertifiedIssuer, IsCa, KeyPair};
use station_core::mqtt::Broker;

use crate::mqtt::mosquitto::Mosquitto;
use crate::mqtt::station::{LEVEL, Station, at, keep_log, logged, wait_for_log};

const PASSWORD: &str = "open sesame";

fn broker(url: &str, port: u16, password: Option<&str>, authority: Option<&str>) -> Broker {
    let url = format!("{url}:{port}");
    Broker::new(&url, password.map(str::to_owned), authority.map(str::as_bytes)).expect("an address")
}

#[tokio::test(flavor = "multi_thread")]
async fn a_wrong_password_is_logged_without_it_and_the_right_one_works() {
    let Some(mosquitto) = Mosquitto::with_user("me", PASSWORD) else { return };
    keep_log();
    let wrong = Station::start(at(broker("mqtt://me@127.0.0.1", mosquitto.port, Some("open barley"), None))).await;
    let line = wait_for_log(&format!("127.0.0.1:{}: the broker refuses the user me", mosquitto.port)).await;
    assert!(line.contains("password is wrong"), "{line}");
    wrong.mqtt.stop().await;
    let nobody = Station::start(at(broker("mqtt://127.0.0.1", mosquitto.port, None, None))).await;
    wait_for_log(&format!("127.0.0.1:{}: the broker wants a user", mosquitto.port)).await;
    nobody.mqtt.stop().await;
    let right = Station::start(at(broker("mqtt://me@127.0.0.1", mosquitto.port, Some(PASSWORD), None))).await;
    right.position("0x1001", [3.0, 2.0]).await;
    mosquitto.listen().first(&format!("baliza/{LEVEL}/tags/0x1001/position"));
    right.mqtt.stop().await;
    assert_eq!(logged(PASSWORD).len() + logged("open barley").len(), 0);
}

/// An authority.
fn authority() -> CertifiedIssuer<'static, KeyPair> {
    let mut params = CertificateParams::new(Vec::new()).expect("no names");
    params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
    CertifiedIssuer::self_signed(params, KeyPair::generate().expect("a key")).expect("a certificate")
}

#[tokio::test(flavor = "multi_thread")]
async fn a_broker_with_tls_is_believed_if_its_authority_is_the_given_one() {
    let (right, wrong) = (authority(), authority());
    let key = KeyPair::generate().expect("a key");
    let names = vec!["localhost".to_owned()];
    let certificate = CertificateParams::new(names).expect("a name").signed_by(&key, &right).expect("signed");
    let files = [("cert.pem", certificate.pem()), ("key.pem", key.serialize_pem()), ("ca.pem", right.pem())];
    let files: Vec<_> = files.iter().map(|(name, text)| (*name, text.as_bytes())).collect();
    let lines = "allow_anonymous true\ncertfile FOLDER/cert.pem\nkeyfile FOLDER/key.pem\n";
    let Some(mosquitto) = Mosquitto::with(lines, &files, &[]) else { return };
    keep_log();
    let port = mosquitto.port;

    let distrustful = Station::start(at(broker("mqtts://localhost", port, None, Some(&wrong.pem())))).await;
    let line = wait_for_log(&format!("localhost:{port}: the broker's certificate is not signed")).await;
    assert!(line.contains("--mqtt-ca"), "{line}");
    distrustful.mqtt.stop().await;
    // The certificate is not for this address.
    let elsewhere = Station::start(at(broker("mqtts://127.0.0.1", port, None, Some(&right.pem())))).await;
    wait_for_log(&format!("127.0.0.1:{port}: the broker's certificate is for another name")).await;
    elsewhere.mqtt.stop().await;
    let station = Station::start(at(broker("mqtts://localhost", port, None, Some(&right.pem())))).await;
    wait_for_log(&format!("connected to localhost:{port}")).await;
    station.mqtt.stop().await;
}
