//! Events, sites, zones, campaigns.

use super::*;
use crate::model::{
    Campaign, CampaignPoint, FloorPlan, GeographicOrigin, HealthFigures, NodeHealth, NodeRole, PlacedNode, SiteMap,
    SurveySample, Zone, ZoneKind,
};

const HOSTILE: [&str; 5] =
    ["'; DROP TABLE sites; --", "<script>alert(1)</script>", "\u{1f9ed} naïve\n\"quoted\" $1 ?1 %s \\", "", " "];

fn ids(events: &[StationEvent]) -> Vec<i64> {
    events.iter().map(|event| event.id).collect()
}

fn campaign(name: &str, points: &[&str]) -> Campaign {
    let point = |id: &&str| CampaignPoint {
        id: (*id).to_owned(),
        x_m: 1.234_567_8,
        y_m: -2.0,
        z_m: None,
        room: Some((*id).to_owned()),
        samples: 0,
    };
    Campaign {
        name: name.to_owned(),
        scenario: name.to_owned(),
        created: at(1),
        points: points.iter().map(point).collect(),
    }
}

on_both! {
    async fn an_event_is_read_as_it_was_written(place) {
        let store = place.open().await;
        let mut events = Vec::new();
        use EventKind::*;
        for (id, kind) in (1..).zip([Entered, Left, Silent, Back, Moved, Uncertain, LowSupply, Refusals]) {
            events.push(StationEvent { alarm: id % 2 == 0, ..event(id, id * 7, kind) });
        }
        events[2].zone = None;
        events[3].dwell_s = None;
        store.write(&[], &events).await.unwrap();
        events.reverse();
        assert_eq!(store.events(None, EVER(), &[], None, 10).await.unwrap(), events);
    }

    async fn placed_nodes_are_read_as_they_were_put(place) {
        let store = place.open().await;
        let node = |site: &str, node: &str, name: Option<&str>| PlacedNode {
            site: site.to_owned(),
            node: node.to_owned(),
            name: name.map(str::to_owned),
            role: NodeRole::Receiver,
            position_m: [1.234_567_8, -2.0, 0.0],
            rssi_1m_dbm: name.map(|_| -61.5),
            path_loss_exponent: name.map(|_| 2.2),
        };
        let mut nodes = vec![node("hall", "1-7", None)];
        nodes.extend(HOSTILE.map(|text| node("yard", text, Some(text))));
        for node in &nodes {
            store.put_node(node).await.unwrap();
        }
        nodes[0].role = NodeRole::Beacon;
        store.put_node(&nodes[0]).await.unwrap();
        let mut read = store.nodes().await.unwrap();
        assert_eq!(read[0], nodes[0]);
        for list in [&mut read, &mut nodes] {
            list.sort_by(|one, other| one.node.cmp(&other.node));
        }
        assert_eq!(read, nodes);
        store.delete_node("hall", "1-7").await.unwrap();
        assert!(matches!(store.delete_node("hall", "1-7").await, Err(StoreError::Missing(_))));
        assert_eq!(store.nodes().await.unwrap().len(), HOSTILE.len());
    }

    async fn events_are_filtered_and_paged_newest_first(place) {
        let store = place.open().await;
        assert_eq!(store.last_event().await.unwrap(), 0);
        // Events 1 to 20 at 1 s to 20 s; odd ones entered, even ones left; every fifth in the yard.
        let events: Vec<_> = (1..=20)
            .map(|id| {
                let kind = if id % 2 == 1 { EventKind::Entered } else { EventKind::Left };
                let site = if id % 5 == 0 { "yard" } else { "hall" };
                StationEvent { site: site.to_owned(), ..event(id, id * 1000, kind) }
            })
            .collect();
        store.write(&[], &events).await.unwrap();
        // One that comes late: its id is the greatest, its time is not.
        store.write(&[], &[event(21, 1500, EventKind::Silent)]).await.unwrap();
        assert_eq!(store.last_event().await.unwrap(), 21);
        let all: Vec<i64> = (2..=20).rev().chain([21, 1]).collect();
        assert_eq!(ids(&store.events(None, EVER(), &[], None, 100).await.unwrap()), all);
        let mut paged = Vec::new();
        loop {
            let page = ids(&store.events(None, EVER(), &[], paged.last().copied(), 4).await.unwrap());
            if page.is_empty() {
                break;
            }
            paged.extend(page);
        }
        assert_eq!(paged, all);
        assert_eq!(ids(&store.events(Some("yard"), EVER(), &[], None, 100).await.unwrap()), [20, 15, 10, 5]);
        let left = [EventKind::Left, EventKind::Silent];
        assert_eq!(ids(&store.events(Some("hall"), span(1000, 8000), &left, None, 100).await.unwrap()), [6, 4, 2, 21]);
        assert_eq!(ids(&store.events(None, EVER(), &[EventKind::Back], None, 100).await.unwrap()), [0; 0]);
        assert_eq!(ids(&store.events(None, EVER(), &[], Some(0), 100).await.unwrap()), [0; 0]);
    }

    async fn health_is_read_minute_by_minute_newest_first(place) {
        let store = place.open().await;
        let known = health("0x0101", 60_000);
        // A beacon of which only the rate is known, and that goes beyond what is stored.
        let bare = |rate_hz| NodeHealth {
            health: HealthFigures { rate_hz, ..HealthFigures::default() },
            ..health("0x0101", 2 * 60_000)
        };
        store.write_health(&[known.clone(), bare(1e12), health("0x0102", 60_000)]).await.unwrap();
        // A second row of a minute is not stored; minutes in between are missing.
        let again = NodeHealth { health: HealthFigures::default(), ..health("0x0101", 119_999) };
        store.write_health(&[again, health("0x0101", 5 * 60_000 + 59_000)]).await.unwrap();
        let minutes = |rows: Vec<NodeHealth>| -> Vec<i64> {
            rows.iter().map(|row| (row.t.us() - at(0).us()) / 60_000_000).collect()
        };
        let read = store.health("hall", "0x0101", EVER(), 10).await.unwrap();
        // 2^31 - 1 hundredths of a hertz are the greatest rate.
        assert_eq!(read, [health("0x0101", 5 * 60_000), bare(21_474_836.47), known]);
        assert_eq!(minutes(store.health("hall", "0x0101", EVER(), 2).await.unwrap()), [5, 2]);
        // A minute is in a span with its beginning.
        assert_eq!(minutes(store.health("hall", "0x0101", span(60_000, 120_000), 9).await.unwrap()), [1]);
        assert_eq!(minutes(store.health("hall", "0x0101", span(60_001, 300_001), 9).await.unwrap()), [5, 2]);
        assert_eq!(store.health("yard", "0x0101", EVER(), 9).await.unwrap(), []);
        assert_eq!(store.health("hall", "0x0103", EVER(), 9).await.unwrap(), []);
    }

    async fn names_may_hold_any_text(place) {
        let store = place.open().await;
        for name in HOSTILE {
            let name = name.to_owned();
            store.put_site(&SiteMap::new(&name)).await.unwrap();
            let zone = Zone {
                site: name.clone(), name: name.clone(), kind: ZoneKind::Room, corners_m: vec![], alarm: false
            };
            store.put_zone(&zone).await.unwrap();
            assert!(store.zones().await.unwrap().contains(&zone));
            let room = Some(name.clone());
            let position = TagPosition { site: name.clone(), tag: name.clone(), room, ..position("", 1) };
            let zone = Some(name.clone());
            let event = StationEvent { site: name.clone(), node: name.clone(), zone, ..event(1, 1, EventKind::Left) };
            store.write(std::slice::from_ref(&position), std::slice::from_ref(&event)).await.unwrap();
            assert_eq!(store.positions(&name, &name, EVER(), 10).await.unwrap(), [position]);
            store.create_campaign(&campaign(&name, &[&name])).await.unwrap();
            let sample = SurveySample { beacon: name.clone(), rssi_dbm: -70.5, t_s: 0.1 };
            store.add_samples(&name, &name, std::slice::from_ref(&sample)).await.unwrap();
            assert_eq!(store.samples(&name, &name, 0, 10).await.unwrap(), [sample]);
            assert_eq!(store.campaign(&name).await.unwrap().points[0].room, Some(name));
        }
        let mut names = HOSTILE;
        names.sort_unstable();
        let mut sites: Vec<_> = store.sites().await.unwrap().into_iter().map(|site| site.name).collect();
        sites.sort_unstable();
        assert_eq!(sites, names);
    }

    async fn the_character_nul_is_kept_or_refused_by_name(place) {
        let store = place.open().await;
        let site = SiteMap::new("a\0b");
        match store.put_site(&site).await {
            Ok(()) => assert_eq!(store.sites().await.unwrap(), [site]),
            Err(error) => assert_eq!(error.to_string(), "a text contains the character U+0000"),
        }
    }

    async fn a_site_keeps_its_plan_when_its_walls_are_replaced(place) {
        let store = place.open().await;
        let plan = FloorPlan {
            origin_m: [0.1, 20.0],
            metres_per_pixel: 0.013,
            rotation_rad: 0.2,
            width_px: 800,
            height_px: 600,
            media_type: "image/png".to_owned(),
        };
        assert!(matches!(store.put_plan("hall", &plan, None).await, Err(StoreError::Missing(_))));
        store.put_site(&SiteMap::new("hall")).await.unwrap();
        assert!(matches!(store.picture("hall").await, Err(StoreError::Missing(_))));
        let picture: Vec<u8> = (0..=255).cycle().take(300_000).collect();
        store.put_plan("hall", &plan, Some(&picture)).await.unwrap();
        let walls_m = vec![[[0.0, 0.0], [10.25, 0.1]]];
        store.put_site(&SiteMap { walls_m: walls_m.clone(), ..SiteMap::new("hall") }).await.unwrap();
        let plan = FloorPlan { metres_per_pixel: 0.014, ..plan };
        store.put_plan("hall", &plan, None).await.unwrap();
        let store = place.open().await;
        assert_eq!(store.sites().await.unwrap(), [SiteMap { walls_m, plan: Some(plan), ..SiteMap::new("hall") }]);
        assert_eq!(store.picture("hall").await.unwrap(), picture);
        assert!(matches!(store.picture("yard").await, Err(StoreError::Missing(_))));
    }

    async fn a_site_keeps_its_geographic_origin_when_walls_and_plan_are_replaced(place) {
        let store = place.open().await;
        let text = r#"{"latitude_deg":40.332,"longitude_deg":-3.766,"y_azimuth_deg":12.5,"height_m":650.0}"#;
        let origin: GeographicOrigin = serde_json::from_str(text).unwrap();
        assert!(matches!(store.put_geographic_origin("hall", Some(&origin)).await, Err(StoreError::Missing(_))));
        for name in ["hall", "yard"] {
            store.put_site(&SiteMap::new(name)).await.unwrap();
        }
        store.put_geographic_origin("hall", Some(&origin)).await.unwrap();
        let walls_m = vec![[[0.0, 0.0], [10.25, 0.1]]];
        let hall = SiteMap { walls_m, ..SiteMap::new("hall") };
        store.put_site(&hall).await.unwrap();
        let store = place.open().await;
        let read = store.sites().await.unwrap();
        assert_eq!(read, [SiteMap { geographic_origin: Some(origin), ..hall.clone() }, SiteMap::new("yard")]);
        assert_eq!(serde_json::to_string(&read[0].geographic_origin).unwrap(), text);
        store.put_geographic_origin("hall", None).await.unwrap();
        assert_eq!(store.sites().await.unwrap(), [hall, SiteMap::new("yard")]);
    }

    async fn a_zone_is_replaced_and_deleted(place) {
        let store = place.open().await;
        let room = Zone {
            site: "hall".to_owned(),
            name: "kitchen".to_owned(),
            kind: ZoneKind::Room,
            corners_m: vec![[0.0, 0.0], [0.1, 0.2], [3.3, 1e-3]],
            alarm: false,
        };
        let zone = Zone { kind: ZoneKind::Zone, alarm: true, corners_m: vec![], ..room.clone() };
        let yard = Zone { site: "yard".to_owned(), ..room.clone() };
        store.put_zone(&yard).await.unwrap();
        store.put_zone(&room).await.unwrap();
        assert_eq!(store.zones().await.unwrap(), [room, yard.clone()]);
        store.put_zone(&zone).await.unwrap();
        assert_eq!(store.zones().await.unwrap(), [zone, yard.clone()]);
        store.delete_zone("hall", "kitchen").await.unwrap();
        assert_eq!(store.zones().await.unwrap(), [yard]);
        let error = store.delete_zone("hall", "kitchen").await.unwrap_err();
        assert_eq!(error.to_string(), "there is no zone \"kitchen\" of site \"hall\"");
    }

    async fn a_campaign_collects_samples_in_their_order(place) {
        let store = place.open().await;
        let made = Campaign {
            points: vec![
                CampaignPoint { z_m: Some(1.1), room: None, ..campaign("", &["2"]).points.remove(0) },
                campaign("", &["1"]).points.remove(0),
            ],
            ..campaign("second floor", &[])
        };
        store.create_campaign(&made).await.unwrap();
        store.create_campaign(&campaign("attic", &["1"])).await.unwrap();
        assert!(matches!(store.create_campaign(&made).await, Err(StoreError::Exists(_))));
        assert!(matches!(store.create_campaign(&campaign("third", &["x", "x"])).await, Err(StoreError::Exists(_))));
        assert_eq!(store.campaigns().await.unwrap(), [campaign("attic", &["1"]), made.clone()]);
        assert_eq!(store.campaign("second floor").await.unwrap(), made);

        let samples: Vec<_> = (0..300)
            .map(|i| SurveySample { beacon: format!("1-{i}"), rssi_dbm: -60.25 - f64::from(i), t_s: f64::from(i) / 3.0 })
            .collect();
        store.add_samples("second floor", "1", &samples[..20]).await.unwrap();
        store.add_samples("second floor", "1", &[]).await.unwrap();
        store.add_samples("second floor", "1", &samples[20..]).await.unwrap();
        assert_eq!(store.samples("second floor", "1", 0, 1000).await.unwrap(), samples);
        assert_eq!(store.samples("second floor", "1", 15, 10).await.unwrap(), samples[15..25]);
        assert_eq!(store.samples("second floor", "1", u64::MAX, 10).await.unwrap(), []);
        assert_eq!(store.samples("attic", "1", 0, 10).await.unwrap(), []);
        let counted = CampaignPoint { samples: 300, ..made.points[1].clone() };
        assert_eq!(store.point("second floor", "1").await.unwrap(), counted);
        for (campaign, point) in [("second floor", "3"), ("none", "1")] {
            assert!(matches!(store.point(campaign, point).await, Err(StoreError::Missing(_))));
            assert!(matches!(store.samples(campaign, point, 0, 1).await, Err(StoreError::Missing(_))));
            assert!(matches!(store.add_samples(campaign, point, &samples).await, Err(StoreError::Missing(_))));
        }

        store.delete_campaign("second floor").await.unwrap();
        assert!(matches!(store.delete_campaign("second floor").await, Err(StoreError::Missing(_))));
        assert!(matches!(store.campaign("second floor").await, Err(StoreError::Missing(_))));
        let left: i64 = sqlx::query_scalar("SELECT COUNT(*) FROM samples").fetch_one(&store.pool).await.unwrap();
        assert_eq!(left, 0);
        assert_eq!(store.campaigns().await.unwrap(), [campaign("attic", &["1"])]);
    }
}
